"""Options of problems: directions and circuits, each against compasses; what the table tells of links."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from benchmarks.synthesis.published import ARC, four_bar
from jaxnc.synthesis.conditions import Seen

S = nc.synthesis
TIMING = np.radians([30, 45, 60, 75, 90])
FEW = {"starts": 300, "refine": 48, "iterations": 60, "keep": 4, "progress": False}


def path(**more):
    return S.PathGeneration(four_bar(), "P", ARC, **({"timing": TIMING, "offset": True} | more))


def values(condition, phi=TIMING):
    system = four_bar().compile()
    ready = condition.prepared(system, "phi")
    return np.asarray(ready.values(Seen(system, nc.sweep(system, {"phi": jnp.asarray(phi)}), None, 1.0)))


def test_directions_and_circuits_are_what_compasses_find():
    points = {n: np.asarray(four_bar().compile()[n]) @ [1, 1j] for n in "ABCD"}
    way = np.angle(points["D"] - points["A"])
    np.testing.assert_allclose(values(S.direction("A", "D", 0.3)), [way - 0.3], atol=1e-12)
    for low, high in ((-0.2, 0.5), (0.1, 0.5), (3.0, 4.0), (6.0, 6.5), (6.3, 7.0)):
        (found,) = values(S.direction("A", "D", min=low, max=high))
        inside = any(low <= way + turn <= high for turn in (0.0, 2 * np.pi))
        assert (found > 0.0) == inside, (low, high)
    # C against the line from B to D, by the sign of the triangle's area; the sine of the transmission angle.
    phi = np.linspace(0.3, 6.0, 7)
    a, b, c = abs(points["B"]), abs(points["C"] - points["B"]), abs(points["C"] - points["D"])
    far = abs(a * np.exp(1j * phi) - points["D"])
    sine = np.sqrt(1.0 - ((b * b + c * c - far**2) / (2 * b * c)) ** 2)
    np.testing.assert_allclose(values(S.on_circuit("left"), phi), sine, rtol=1e-9)
    np.testing.assert_allclose(values(S.on_circuit("right"), phi), -sine, rtol=1e-9)
    np.testing.assert_allclose(values(S.on_circuit("right", joint=("D", "C", "B")), phi), sine, rtol=1e-9)


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_designs_stand_as_they_are_asked_to(side, sign):
    wanted = [S.on_circuit(side), S.direction("A", "D", 0.25 * np.pi), S.crank_turns()]
    found = S.solve(path(subject_to=wanted), **FEW)
    assert found.found
    for design in (d for d in found.designs if not d.defects):
        b, c, d, a = (np.asarray(design.motion[n]) @ [1, 1j] for n in "BCDA")
        assert (sign * ((d - b).conj() * (c - b)).imag > 0.0).all()
        np.testing.assert_allclose(np.angle(d - a), 0.25 * np.pi, atol=1e-7)


def test_lengths_of_links_are_told():
    found = S.solve(path(), **(FEW | {"iterations": 20}))
    best = found.designs[0]
    for name, length in best.lengths.items():
        a, b = (np.asarray(best.system[n]) for n in name.split("-"))
        np.testing.assert_allclose(length, np.linalg.norm(a - b), rtol=1e-9)
    assert list(best.lengths) == ["A-B", "B-C", "B-P", "C-P", "C-D", "A-D"]
    lines = str(found).splitlines()
    at = lines.index("lengths [m]")
    assert lines[at + 1].split() == list(best.lengths)
    np.testing.assert_allclose([float(w) for w in lines[at + 2].split()[1:]], list(best.lengths.values()), rtol=1e-4)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: S.direction("A", "D"), "give a value, or min= and max="),
        (lambda: S.direction("A", "D", min=0.1), "give a value, or min= and max="),
        (lambda: S.direction("A", "D", 45), "must be an angle in radians .numpy.radians"),
        (lambda: S.direction("A", "D", min=1.0, max=0.5), "a way forwards of less than a turn; add 2.pi"),
        (lambda: S.on_circuit("open"), "side='open'; known names: left, right"),
        (lambda: path(subject_to=[S.direction("A", "E", 0.0)]), "has no point 'E'"),
        (
            lambda: S.PathGeneration(nc.library.rssr(), "A", np.eye(3), input="phi", subject_to=[S.on_circuit("left")]),
            "is spatial; this condition is of the plane",
        ),
    ],
)
def test_mistakes_are_named(make, words):
    with pytest.raises(nc.InputError, match=words):
        make()
