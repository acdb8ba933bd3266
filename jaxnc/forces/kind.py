"""What a kind of force is: energy, dissipation or force of one instance, and a record of what it takes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from jaxnc.calls import public
from jaxnc.pickling import Remade


@public
@dataclass(frozen=True)
class ForceKind(Remade):
    """A kind of force as pure functions of one instance's own points, vectors, scalars and parameters.

    The functions get ``p`` of shape ``(points, dim)``, ``v`` ``(vectors, dim)``, ``s`` ``(scalars,)``, their rates
    ``dp, dv, ds``, parameters ``c`` ``(parameters,)`` and the time ``t``. What is given is added up; generalised forces
    of energies follow by differentiation, so that nothing is derived by hand.

    Args:
        name: unique name, used in reports, files and messages.
        parameters: names of its parameters; each becomes a design variable ``<force>.<parameter>``.
        points: how many points an instance takes.
        vectors: how many unit vectors.
        scalars: how many scalar coordinates (angles, distances, single coordinates of points).
        potential: ``(p, v, s, c) -> energy``, J.
        dissipation: ``(p, v, s, dp, dv, ds, c) -> R``, Rayleigh's function; the force is minus its derivative with
            respect to the rates, N.
        force: ``(t, p, v, s, dp, dv, ds, c) -> (fp, fv, fs)``: forces on what it takes, in the same shapes.
        drawn: ``(p, v, s) -> c``: parameters as the drawing has them (a spring's free length); they stand for what is
            not given. Those of which it says None must be given.
        positive: names of parameters that may not be negative.
    """

    noun = "kind of force"
    name: str
    parameters: tuple[str, ...] = ()
    points: int = 0
    vectors: int = 0
    scalars: int = 0
    potential: Callable[..., Any] | None = None
    dissipation: Callable[..., Any] | None = None
    force: Callable[..., Any] | None = None
    drawn: Callable[..., Any] | None = None
    positive: tuple[str, ...] = ()

    def __post_init__(self):
        if self.potential is None and self.dissipation is None and self.force is None:
            raise ValueError(f"force kind {self.name!r} has neither potential, dissipation nor force")
