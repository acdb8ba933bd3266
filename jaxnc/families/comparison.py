"""The families of coordinates side by side, on one mechanism: counts, equations, and what solving them costs."""

import csv
import functools
import io
import json
import timeit
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxnc.calls import public
from jaxnc.compiling import jit
from jaxnc.errors import InputError, JaxncError
from jaxnc.families.formulation import FAMILIES, Formulation, formulate, measure_all
from jaxnc.kinematics.position import solve_position
from jaxnc.mechanism import Mechanism
from jaxnc.notebooks import align_columns
from jaxnc.solvers.assembly import derive, evaluate
from jaxnc.solvers.newton import largest, step_of_newton, tolerance
from jaxnc.solvers.plan import Plan, plan
from jaxnc.system.equations import Equations, places, weights
from jaxnc.system.system import System
from jaxnc.types import Array

SPREADS = (0.03, 0.1, 0.3, 1.0)
"""How far the points of the starts are from the drawing, as a part of the mechanism's size."""

_STARTS = 256  # for each spread


@dataclass
class Row:
    """One family. Everything is of the family's own coordinates and equations up to `condition`."""

    family: str  # its name
    n: int | None = None  # variables
    r: int | None = None  # independent equations
    g: int | None = None  # degrees of freedom
    rows: int | None = None  # equations as written
    nonzeros: int | None = None  # numbers of the Jacobian that can differ from zero
    # Degree of the equations, sines and cosines counting as variables; None if they are no polynomials.
    degree: int | None = None
    trigonometric: int | None = None  # sines and cosines written in them
    # Condition number of the Jacobian with the inputs driven, angles measured as lengths.
    condition: float | None = None
    solved: int | None = None  # variables of the position problem, the inputs kept
    # Newton's iterations from the drawing to the displaced input; None if it does not converge.
    iterations: int | None = None
    microseconds: float | None = None  # time of one solve of 30 steps in the batch of all starts
    # Part of the starts that end at the drawing's assembly, by how far away they start.
    basin: tuple[float, ...] | None = None
    converged: tuple[float, ...] | None = None  # part of the starts that end at any assembly
    note: str = ""  # why there are no numbers


_COLUMNS = (
    ("family", "family"), ("n", "n"), ("r", "r"), ("g", "g"), ("rows", "rows"), ("non-zeros", "nonzeros"),
    ("degree", "degree"), ("sin, cos", "trigonometric"), ("condition", "condition"), ("n solved", "solved"),
    ("iterations", "iterations"), ("µs a solve", "microseconds"), ("basin", "basin"), ("any", "converged"),
)  # fmt: skip


@public
@dataclass
class Comparison:
    """Families of coordinates on one mechanism.

    Attributes:
        mechanism: its name.
        inputs: what is driven, and by how much it is displaced.
        families: a row for each.
        formulations: the formulations, by family.
    """

    mechanism: str
    inputs: dict[str, float]
    families: list[Row]
    formulations: dict[str, Formulation]

    def __str__(self) -> str:
        table = [[title for title, _ in _COLUMNS]]
        table += [[_show_cell(getattr(row, key)) for _, key in _COLUMNS] for row in self.families]
        moved = ", ".join(f"{name} by {value:.3g}" for name, value in self.inputs.items())
        notes = [f"  {row.family}: {row.note}" for row in self.families if row.note]
        spreads = ", ".join(f"{s:g}" for s in SPREADS)
        return "\n".join([
            f"{self.mechanism}: families of coordinates", *align_columns(table, left=(0,)), *notes,
            f"  displaced: {moved}; iterations of undamped Newton from the drawing",
            f"  basin, any: parts of {_STARTS} random starts that end at the drawing's assembly, and at any, their "
            f"points {spreads} of the mechanism's size away",
        ])  # fmt: skip

    __repr__ = __str__

    def to_csv(self) -> str:
        """The table as comma-separated values."""
        out = io.StringIO()
        writer = csv.writer(out, lineterminator="\n")
        spread = [f"{k} {s:g}" for k in ("basin", "converged") for s in SPREADS]
        plain = [f.name for f in fields(Row) if f.name not in ("basin", "converged")]
        writer.writerow([*plain, *spread])
        for row in self.families:
            cells = [getattr(row, name) for name in plain]
            for key in ("basin", "converged"):
                cells += list(getattr(row, key) or ("",) * len(SPREADS))
            writer.writerow(["" if c is None else c for c in cells])
        return out.getvalue()

    def to_json(self) -> str:
        """The table as JSON."""
        rows = [asdict(row) for row in self.families]
        whole = {"mechanism": self.mechanism, "displaced": self.inputs, "spreads": SPREADS, "families": rows}
        return json.dumps(whole, indent=2, ensure_ascii=False)


def _show_cell(value: object) -> str:
    if value is None:
        return "-"
    if isinstance(value, tuple):
        return " ".join(f"{x:.2f}" for x in value)
    return f"{value:.3g}" if isinstance(value, float) else str(value)


@public
def compare(
    mechanism: Mechanism,
    families: Sequence[str] = FAMILIES,
    inputs: Sequence[str] = (),
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Comparison:
    """Compare families of coordinates on one mechanism.

    Args:
        mechanism: the description.
        families: which.
        inputs: what is driven, as many coordinates as there are freedoms; the mechanism's first angles and distances
            if not given. They are kept as variables for the position problem, which is then the same in every family.
        seed: another number gives other starts.
        progress: called with the family that is looked at.

    Raises:
        InputError: unknown families or inputs, not as many inputs as freedoms.
    """
    natural = mechanism.compile()
    names = tuple(inputs) or tuple(natural.topology.scalars)[: natural.degrees_of_freedom]
    if len(names) != natural.degrees_of_freedom:
        raise InputError(
            f"{natural.name!r} has {natural.degrees_of_freedom} degrees of freedom, and {len(names)} inputs: name as "
            f"many angles, distances or coordinates of points, in the file under [run.inputs]"
        )
    home = solve_position(natural, {n: float(derive(natural).home[natural.topology.position[n]]) for n in names})
    size = float(derive(natural).length)
    # radians; distances are displaced by a part of the mechanism's size
    moved = {n: 0.3 if natural.topology.is_angle(n) else 0.05 * size for n in names}
    starts = _starts(natural, np.asarray(home.q), seed)
    rows, made = [], {}
    for family in families:
        if progress:
            progress(family)
        row = Row(family)
        rows.append(row)
        try:
            made[family] = _count_family(mechanism, row, names)
            if row.r or family != "independent":
                _solve_family(mechanism, row, names, moved, starts)
        except JaxncError as error:
            row.note = str(error)
    return Comparison(natural.name, moved, rows, made)


def _starts(natural: System, home: np.ndarray, seed: int) -> np.ndarray:
    """The assembled drawing, then poses whose moving points are off it, ``(1 + starts, N)``."""
    top = natural.topology
    rng = np.random.default_rng(seed)
    size = float(derive(natural).length)
    first = top.dim * len(top.points)
    free = np.array([i for i in top.unknown if i < first + top.dim * len(top.vectors)], int)
    off = np.where(free < first, size, 1.0) * np.repeat(SPREADS, _STARTS)[:, None]
    out = np.tile(home, (1 + len(off), 1))
    out[1:, free] += off * rng.normal(size=off.shape) / np.sqrt(top.dim)
    return np.asarray(measure_all(natural, out))


def _count_family(mechanism: Mechanism, row: Row, names: tuple[str, ...]) -> Formulation:
    """The counts of a family."""
    f = formulate(mechanism, row.family, keep=names if row.family == "independent" else ())
    row.n, row.r, row.g, row.rows = f.n, f.r, f.g, f.rows
    top = f.topology
    r, c, nonzero = places(top)
    inside = np.isin(c, top.unknown) & nonzero
    row.nonzeros = len(set(zip(r[inside].tolist(), c[inside].tolist(), strict=True)))
    written = f.equations()
    row.degree, row.trigonometric = written.degree, written.trigonometric
    return f


def _solve_family(
    mechanism: Mechanism, row: Row, names: tuple[str, ...], moved: dict[str, float], starts: np.ndarray
) -> None:
    """The position problem of a family with the inputs kept."""
    known = mechanism.scalar_names if row.family == "natural" else names
    keep = tuple(n for n in names if n in known) if row.family in ("natural", "relative", "reference") else ()
    f = formulate(mechanism, row.family, keep=keep)
    system = f.system
    top, eq = system.topology, derive(system)
    view = plan(top, names, (), system.degrees_of_freedom)
    z = np.asarray(f.from_natural(starts, continuous=False))
    q = np.broadcast_to(np.asarray(eq.home), (len(z), len(top.coordinates))).copy()
    q[:, top.unknown] = z
    at = [top.position[n] for n in names]
    q[:, at] = q[0, at]
    jacobian = np.asarray(evaluate(eq, q[0])[1])[np.ix_(view.rows, view.unknown)]
    values = np.linalg.svd(jacobian / np.asarray(weights(eq))[view.unknown], compute_uv=False)
    row.condition = float(values[0] / values[-1]) if values.size and values[-1] > 0 else None
    row.solved = len(view.unknown)
    # The first lane is the displacement, from the drawing; all others solve for the drawing's own inputs.
    q[0, at] += [moved[n] for n in names]
    poses, most = jnp.array(q), 30  # steps of Newton
    end, needed = (np.asarray(x) for x in _attempt(view, eq, poses, most))
    spent = timeit.repeat(lambda: jax.block_until_ready(_attempt(view, eq, poses, most)), number=1, repeat=3)
    row.microseconds = 1e6 * float(np.median(spent)) / len(starts)
    row.iterations = int(needed[0]) if needed[0] <= most else None
    good = needed[1:] <= most
    natural = np.asarray(f.to_natural(end[1:][:, top.unknown]))
    spread = natural.shape[1] - len(f.natural.topology.scalars)
    size = float(derive(f.natural).length)
    # 1e-4 of the mechanism's size: closer poses are the same assembly
    same = good & (np.abs(natural[:, :spread] - starts[0, :spread]).max(axis=1) < 1e-4 * size)
    row.basin = tuple(float(x) for x in same.reshape(len(SPREADS), -1).mean(axis=1))
    row.converged = tuple(float(x) for x in good.reshape(len(SPREADS), -1).mean(axis=1))


@functools.partial(jit, static_argnums=(0, 3))
def _attempt(view: Plan, eq: Equations, starts: Array, iterations: int) -> tuple[Array, Array]:
    """Newton's method as it is written in a book (Gauss-Newton, with redundant rows): undamped, all starts alike.

    What the library solves with is safer. Of starts ``(B, N)`` the last poses, and how many steps each needed to meet
    the tolerance, ``(B,)``; `iterations` + 1 if it did not.
    """

    def one(q: Array) -> tuple[Array, Array]:
        def step(state, k):
            q, needed = state
            r, jacobian = view.linearise(eq, q)
            needed = jnp.where((largest(r) <= tolerance(eq, q)) & (needed > k), k, needed)
            return (step_of_newton(view, eq, q, r, jacobian), needed), None

        (q, needed), _ = lax.scan(step, (q, jnp.full((), iterations + 1)), jnp.arange(iterations))
        met = largest(view.linearise(eq, q)[0]) <= tolerance(eq, q)
        return q, jnp.where(met & (needed > iterations), iterations, needed)

    return jax.vmap(one)(starts)
