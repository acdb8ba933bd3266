"""Six-bar linkages: the inversions of Watt's and of Stephenson's chain, drawn by their joints."""

from collections.abc import Mapping
from dataclasses import dataclass

from jaxnc.calls import public
from jaxnc.library.drawing import TURN, Point, choice, drive, hardpoints
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism.model import Place


@dataclass(frozen=True)
class _Inversion:
    """One inversion: its joints as drawn, which of them are on the ground, and its bodies."""

    ground: str
    places: Mapping[str, Point]
    bodies: Mapping[str, list[str]]
    output: str


_WATT = {
    "I": _Inversion(
        "AD",
        {
            "A": (0.0, 0.0),
            "D": (0.40, 0.0),
            "B": (0.05, 0.09),
            "C": (0.36, 0.30),
            "E": (0.12, 0.40),
            "F": (0.55, 0.36),
            "G": (0.38, 0.60),
        },
        {
            "crank": ["A", "B"],
            "coupler": ["B", "C", "E"],
            "rocker": ["D", "C", "F"],
            "link1": ["E", "G"],
            "link2": ["F", "G"],
        },
        "G",
    ),
    "II": _Inversion(
        "ADG",
        {
            "A": (0.0, 0.0),
            "D": (0.40, 0.0),
            "G": (0.90, 0.05),
            "B": (0.05, 0.09),
            "C": (0.36, 0.30),
            "E": (0.50, 0.28),
            "F": (0.84, 0.36),
        },
        {
            "crank": ["A", "B"],
            "coupler": ["B", "C"],
            "rocker": ["D", "C", "E"],
            "link": ["E", "F"],
            "output": ["G", "F"],
        },
        "F",
    ),
}
_STEPHENSON = {
    "I": _Inversion(
        "AD",
        {
            "A": (0.0, 0.0),
            "D": (0.40, 0.0),
            "B": (0.05, 0.09),
            "E": (-0.08, 0.06),
            "C": (0.36, 0.30),
            "F": (0.28, 0.36),
            "G": (0.05, 0.55),
        },
        {
            "crank": ["A", "B", "E"],
            "coupler": ["B", "C"],
            "rocker": ["D", "C", "F"],
            "link1": ["E", "G"],
            "link2": ["F", "G"],
        },
        "G",
    ),
    "II": _Inversion(
        "AD",
        {
            "A": (0.0, 0.0),
            "D": (0.40, 0.0),
            "B": (0.05, 0.09),
            "C": (0.37, 0.33),
            "E": (0.24, 0.50),
            "F": (0.44, 0.18),
            "G": (0.16, 0.25),
        },
        {
            "crank": ["A", "B"],
            "coupler": ["B", "C", "E"],
            "link1": ["C", "F"],
            "link2": ["E", "G"],
            "rocker": ["D", "F", "G"],
        },
        "E",
    ),
    "III": _Inversion(
        "ADG",
        {
            "A": (0.0, 0.0),
            "D": (0.40, 0.0),
            "G": (0.75, 0.10),
            "B": (0.05, 0.09),
            "C": (0.36, 0.30),
            "E": (0.30, 0.50),
            "F": (0.70, 0.45),
        },
        {
            "crank": ["A", "B"],
            "coupler": ["B", "C", "E"],
            "rocker": ["D", "C"],
            "link": ["E", "F"],
            "output": ["G", "F"],
        },
        "F",
    ),
}


@public
def watt_six_bar(inversion: str = "II", places: Mapping[str, Place] | None = None) -> Mechanism:
    """Six-bar linkage of Watt's chain, in which the two bodies with three joints are neighbours.

    Inversion I: crank A-B, coupler B-C-E, rocker D-C-F, links E-G and F-G; n = 11, rows = 10, rank 10, g = 1.
    Inversion II: two four-bars in a row, crank A-B, coupler B-C, rocker D-C-E, link E-F, output G-F; n = 9, rows = 8,
    rank 8, g = 1. Input ``phi``, the angle of the crank AB from the x axis; the default drive is a full turn, which the
    default places allow.

    Args:
        inversion: ``"I"`` or ``"II"``: which body of the chain is the ground.
        places: where joints are drawn, ``{"E": (x, y)}``, lengths, instead of their default places; lengths of bars
            and the home value of phi follow.

    Raises:
        MechanismError: for an unknown inversion or joint, or two joints of one body at the same place.

    Source: R. L. Norton, Design of Machinery, Watt's chain and its inversions.
    """
    return _six_bar("watt_six_bar", _WATT, inversion, places)


@public
def stephenson_six_bar(inversion: str = "III", places: Mapping[str, Place] | None = None) -> Mechanism:
    """Six-bar linkage of Stephenson's chain, in which the two bodies with three joints are not neighbours.

    Inversion I: crank A-B-E, coupler B-C, rocker D-C-F, links E-G and F-G; n = 11, rows = 10, rank 10, g = 1.
    Inversion II: crank A-B, coupler B-C-E, links C-F and E-G, rocker D-F-G; n = 11, rows = 10, rank 10, g = 1; no part
    of it closes by itself, so its poses are not found by drawing circles.
    Inversion III: a four-bar A-B-C-D with coupler point E, link E-F, output G-F; n = 9, rows = 8, rank 8, g = 1.
    Input ``phi``, the angle of the crank AB from the x axis; the default drive is a full turn, which the default places
    allow.

    Args:
        inversion: ``"I"``, ``"II"`` or ``"III"``: which body of the chain is the ground.
        places: where joints are drawn, ``{"E": (x, y)}``, lengths, instead of their default places; lengths of bars
            and the home value of phi follow.

    Raises:
        MechanismError: for an unknown inversion or joint, or two joints of one body at the same place.

    Source: R. L. Norton, Design of Machinery, Stephenson's chain and its inversions.
    """
    return _six_bar("stephenson_six_bar", _STEPHENSON, inversion, places)


def _six_bar(
    what: str, table: Mapping[str, _Inversion], inversion: str, places: Mapping[str, Place] | None
) -> Mechanism:
    data = table[choice(what, "inversion", inversion, table)]
    at = hardpoints(what, data.places, data.bodies, places)
    title = what.split("_")[0].capitalize()
    m = Mechanism(
        f"{title} six-bar {inversion}", description=f"Six-bar linkage of {title}'s chain, inversion {inversion}."
    )
    for name, spot in at.items():
        (m.ground if name in data.ground else m.point)(name, spot)
    for name, points in data.bodies.items():
        m.body(name, points)
    m.angle("phi", at="A", to="B")
    return drive(m, [data.output], {"phi": (0.0, TURN)})
