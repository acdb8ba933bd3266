"""Function generation at precision points: Freudenstein's equation for four-bars, and its kin for slider-cranks."""

import dataclasses
import math
import warnings
from collections.abc import Callable

import numpy as np

from jaxnc.calls import public
from jaxnc.errors import InputError, counted
from jaxnc.kinematics.inputs import one_number, whole
from jaxnc.kinematics.instant import transmission_angle
from jaxnc.kinematics.position import sweep
from jaxnc.synthesis.exact.linkage import FourBar, Listed, SliderCrank, sweep_through, wrap_angle
from jaxnc.synthesis.validate import as_floats
from jaxnc.system.system import System
from jaxnc.types import Any, ArrayLike, Float
from jaxnc.validate import as_shape, call_user, function_name

POSES = 121
"""Poses of the range at which the structural error is looked at."""

_NOTHING = 1e-7  # of the largest: what stands for a bar of no length, or at infinity, also in a double root


@public
def chebyshev_points(count: int, over: tuple[float, float] = (-1.0, 1.0)) -> Float[np.ndarray, " count"]:
    """Chebyshev spacing of precision points, which makes the error between them nearly even.

    Args:
        count: how many points.
        over: the range, both ends outside of the points.

    Returns:
        The points in order: middle of the range - half its length · cos((2k - 1) π / 2n), k = 1 … n.

    Raises:
        InputError: no points, or a range without length.

    Source: P. L. Chebyshev (1854); R. S. Hartenberg and J. Denavit, Kinematic Synthesis of Linkages (1964), chapter 5.
    """
    low, high = _as_range("over", over)
    count = whole(count, "Chebyshev spacing: count")
    k = np.arange(1, count + 1)
    return 0.5 * (low + high) - 0.5 * (high - low) * np.cos((2 * k - 1) * np.pi / (2 * count))


@public
@dataclasses.dataclass(frozen=True)
class FunctionDesign:
    """A four-bar that generates a function; ``print()`` says how well.

    Attributes:
        linkage: the four-bar, drawn at the first precision point; the ground A-D lies along the x axis.
        input_offset: angle φ of the crank where the scale of the input is zero, radians. Where the equations have a bar
            of negative length, it stands half a turn from the offset that was given.
        output_offset: angle ψ of the rocker where the scale of the output is zero, radians; likewise.
        inputs: input scale at the precision points, radians, ``(n,)``.
        outputs: output scale at the precision points, radians, ``(n,)``.
        grid: input scale over the range, ``(121,)``; only with a range.
        structural_error: output - wanted output over the range, radians, ``(121,)``; NaN where it does not move.
        error: largest deviation at the precision points after really moving through them, radians; NaN if not reached.
        transmission: smallest transmission angle on the way, radians.
        defects: ``"branch"``: some precision point is met on the other branch only; ``"dead point"``: the input cannot
            go through the range. Empty: the design works.
    """

    linkage: FourBar
    input_offset: float
    output_offset: float
    inputs: np.ndarray
    outputs: np.ndarray
    grid: np.ndarray
    structural_error: np.ndarray
    error: float
    transmission: float
    defects: tuple[str, ...]

    @property
    def system(self) -> System:
        """The compiled linkage: drive ``phi``, read ``psi``."""
        return self.linkage.system

    @property
    def worst(self) -> float:
        """Largest structural error over the range, radians; NaN where the range is not passed."""
        return float(np.abs(self.structural_error).max()) if len(self.structural_error) else self.error

    def __repr__(self) -> str:
        sizes = ", ".join(f"{name} {value:.6g}" for name, value in self.linkage.lengths.items())
        state = ", ".join(self.defects) + " defect" if self.defects else "works"
        return (
            f"four-bar: {sizes}; φ0 = {math.degrees(self.input_offset):.4f}°, "
            f"ψ0 = {math.degrees(self.output_offset):.4f}°; {self.linkage.grashof.type}; "
            f"structural error {math.degrees(self.worst):.4g}°; "
            f"transmission angle ≥ {math.degrees(self.transmission):.1f}°; {state}"
        )


@public
@dataclasses.dataclass(frozen=True)
class FunctionDesigns(Listed[FunctionDesign]):
    """All four-bars that meet the precision points, those without defects first, by structural error.

    Attributes:
        designs: the designs.
        rejected: why other solutions of the equations are no linkages, a sentence each.
    """

    designs: tuple[FunctionDesign, ...]
    rejected: tuple[str, ...]

    @property
    def best(self) -> FunctionDesign:
        """The first design.

        Raises:
            InputError: there is none.
        """
        if not self.designs:
            raise InputError(f"no four-bar meets these precision points: {'; '.join(self.rejected) or 'no real root'}")
        return self.designs[0]

    def __repr__(self) -> str:
        lines = [f"{counted(len(self.designs), 'four-bar')} through the precision points"]
        lines += [f"  {k + 1}. {design}" for k, design in enumerate(self.designs)]
        return "\n".join([*lines, *(f"  no linkage: {why}" for why in self.rejected)])


@public
def precision_four_bars(
    inputs: ArrayLike,
    outputs: ArrayLike,
    input_offset: float | None = 0.0,
    output_offset: float | None = 0.0,
    ground: float = 1.0,
    over: tuple[float, float] | None = None,
    function: Callable[[np.ndarray], ArrayLike] | None = None,
) -> FunctionDesigns:
    """All four-bars whose rocker stands at given angles when the crank does, at 3, 4 or 5 precision points.

    Freudenstein's equation for the crank angle φ = φ0 + input and the rocker angle ψ = ψ0 + output, both from the
    ground A-D: K1 cos ψ - K2 cos φ + K3 = cos(φ - ψ), with K1 = ground/crank, K2 = ground/rocker and
    K3 = (crank² - coupler² + rocker² + ground²)/(2 crank rocker). Three points determine the bars (linear); a fourth
    one of the offsets φ0, ψ0 (a quadratic in its tangent), a fifth both (a cubic). Every real solution is moved through
    its range and checked.

    Args:
        inputs: input scale at the precision points, radians, ``(n,)``, in order.
        outputs: output scale at the precision points, radians, ``(n,)``.
        input_offset: φ0, radians; None: to be found.
        output_offset: ψ0, radians; None: to be found. There are 3 points and one more for each offset to be found.
        ground: distance A-D of the fixed pivots, a length.
        over: range of the input scale; from the first to the last precision point if not given.
        function: output scale wanted over the range, of an array of inputs, for the structural error.

    Returns:
        The designs, those without defects first; roots that are no linkage are named in ``rejected``.

    Raises:
        InputError: points that are not numbers, not in order, too few or too many, or that repeat.

    Source: F. Freudenstein, Approximate synthesis of four-bar linkages, Trans. ASME 77 (1955) 853-861. The solution of
    four and five points as homogeneous quadratic and cubic is derived here.
    """
    x, y = check_points("precision_four_bars", inputs, outputs)
    need = 3 + (input_offset is None) + (output_offset is None)
    if len(x) != need:
        raise InputError(
            f"precision_four_bars: {len(x)} precision points; with {need - 3} offsets to be found there must be "
            f"{need}. input_offset=None and output_offset=None each allow one point more"
        )
    if not (math.isfinite(ground) and ground > 0):
        raise InputError(f"precision_four_bars: ground = {ground} must be a positive length")
    input_offset, output_offset = (
        None if value is None else one_number(value, f"precision_four_bars: {name}")
        for value, name in ((input_offset, "input_offset"), (output_offset, "output_offset"))
    )
    # So near to a straight line of slope one, in radians, rounding decides where bars end.
    if need > 3 and float(np.ptp(y - x)) < 1e-9 * float(np.ptp(x)):
        every = "the output turns as the input does: every parallelogram meets the points, its bars as long as you like"
        return FunctionDesigns((), (every,))
    if input_offset is not None and output_offset is not None:
        solutions: list = [_solve_three(x + input_offset, y + output_offset, input_offset, output_offset)]
    elif need == 4:
        solutions = _solve_four(x, y, input_offset, output_offset)
    else:
        solutions = _solve_five(x, y)
    designs: list[FunctionDesign] = []
    rejected: list[str] = []
    low, high = (x[0], x[-1]) if over is None else _as_range("over", over)
    for solution in solutions:
        linkage = _draw_linkage(solution, x[0], y[0], ground)
        if isinstance(linkage, str):
            rejected.append(linkage)
        else:
            designs.append(_move_design(linkage, solution, x, y, (float(low), float(high)), function))
    designs.sort(key=lambda d: (len(d.defects), d.worst if math.isfinite(d.worst) else math.inf))
    return FunctionDesigns(tuple(designs), tuple(rejected))


@public
def function_four_bars(
    function: Callable[[np.ndarray], ArrayLike],
    over: tuple[float, float],
    input_range: float,
    output_range: float,
    points: int | ArrayLike | None = None,
    input_start: float | None = None,
    output_start: float | None = None,
    ground: float = 1.0,
) -> FunctionDesigns:
    """Four-bars that generate y = f(x) at Chebyshev-spaced (or given) precision points.

    Both scales are linear: the crank turns by `input_range` while x passes its range, the rocker by `output_range`
    while y goes from f(start) to f(end).

    Args:
        function: f, of an array.
        over: the range of x.
        input_range: turn of the crank over the range, radians, negative for clockwise.
        output_range: turn of the rocker, radians.
        points: the precision points in x, or how many by Chebyshev spacing; as many as there are unknowns if not given.
        input_start: crank angle φ at the start of the range, radians; None: to be found.
        output_start: rocker angle ψ at the start of the range, radians; None: to be found.
        ground: distance A-D, a length.

    Returns:
        The designs, as from `precision_four_bars`.

    Raises:
        InputError: as in `precision_four_bars`; a function that is not finite or does not change over the range.
    """
    low, high = _as_range("over", over)
    need = 3 + (input_start is None) + (output_start is None)
    chosen = need if points is None else points
    if np.ndim(chosen) == 0 and chosen != need:
        raise InputError(
            f"function_four_bars: points = {chosen}, but there are {need} unknowns; give input_start and output_start "
            f"for 3 points, one of them for 4, none for 5"
        )
    at = chebyshev_points(need, (low, high)) if np.ndim(chosen) == 0 else np.asarray(chosen, float)
    if not callable(function):
        raise InputError(f"function_four_bars: the function of x is what is to be generated, got {function!r}")
    ends = _call_function(function, np.array([low, high]), "function_four_bars")
    if ends.shape != (2,) or not np.isfinite(ends).all() or ends[0] == ends[1]:
        raise InputError(
            f"function_four_bars: the function is {ends} at the ends of the range; they must be two different numbers"
        )
    for name, value in (("input_range", input_range), ("output_range", output_range)):
        if not (math.isfinite(value) and value):
            raise InputError(f"function_four_bars: {name} = {value} must be an angle other than zero")
        if abs(value) > 2.0 * math.pi:
            raise InputError(
                f"function_four_bars: {name} = {value} is more than a turn: angles are in radians, "
                f"numpy.radians({value})"
            )

    def scaled(u: np.ndarray) -> np.ndarray:
        v = _call_function(function, low + np.asarray(u) / input_range * (high - low), "function_four_bars")
        return (v - ends[0]) / (ends[1] - ends[0]) * output_range

    inputs = (at - low) / (high - low) * input_range
    return precision_four_bars(inputs, scaled(inputs), input_start, output_start, ground, (0.0, input_range), scaled)


@public
def slider_crank_function(inputs: ArrayLike, outputs: ArrayLike) -> tuple[SliderCrank, float]:
    """The slider-crank whose slider stands at three given places when its crank stands at three given angles.

    With the crank pivot as origin, the guide parallel to the x axis at height e and the slider at s:
    s² = K1 s cos φ + K2 sin φ + K3, with K1 = 2 crank, K2 = 2 crank e, K3 = conrod² - crank² - e²; linear.

    Args:
        inputs: crank angles φ from the x axis, radians, ``(3,)``, in order.
        outputs: places s of the slider along x from the crank pivot, lengths, ``(3,)``.

    Returns:
        The slider-crank, drawn at the first angle (or, with a warning, half a turn from it, where the equations have a
        crank of negative length), and the largest deviation of s after really moving it through the
        three angles, a length; NaN if a dead point stops it, as large as it is if it changes its branch.

    Raises:
        InputError: not three angles and places, or a crank without length.

    Source: F. Freudenstein (1955) by analogy; R. S. Hartenberg and J. Denavit, Kinematic Synthesis of Linkages (1964),
    chapter 10.
    """
    phi, s = check_points("slider_crank_function", inputs, outputs)
    if len(phi) != 3:
        raise InputError(f"slider_crank_function: {len(phi)} inputs and outputs; there must be three of each")
    unit = float(np.abs(s).max()) or 1.0
    matrix = np.stack([s / unit * np.cos(phi), np.sin(phi), np.ones(3)], axis=1)
    if np.linalg.cond(matrix) > 1e13:
        raise InputError("slider_crank_function: the three equations do not determine the bars; choose other inputs")
    k = np.linalg.solve(matrix, (s / unit) ** 2)
    crank = 0.5 * unit * k[0]
    if abs(crank) < 1e-12 * unit:
        raise InputError("slider_crank_function: the crank would have no length; choose other outputs")
    offset = unit * k[1] / k[0]
    pin = crank * np.exp(1j * phi[0])
    found = SliderCrank((0.0, 0.0), (pin.real, pin.imag), (float(s[0]), float(offset)))
    turned = phi + (math.pi if crank < 0 else 0.0)
    if crank < 0:
        warnings.warn(
            "slider_crank_function: the equations have a crank of negative length, which is drawn half a turn "
            "from the angles given",
            UserWarning,
            stacklevel=3,
        )
    turned = turned - 2 * np.pi * np.round((turned[0] - np.angle(pin)) / (2 * np.pi))
    motion, at = sweep_through(found.system, turned, 30)
    if not np.asarray(motion.converged).all():
        return found, math.nan
    return found, float(np.abs(np.asarray(motion["C"])[at, 0] - s).max())


def _call_function(function: Callable[[np.ndarray], Any], x: np.ndarray, what: str) -> np.ndarray:
    """Values of the user's function, one for each of its arguments."""
    try:
        found = call_user(function, f"{what}: function", "x", x)
    except (TypeError, ValueError):
        for number in x:  # another fault passes through
            call_user(function, f"{what}: function", "x", float(number))
        raise InputError(
            f"{what}: function: {function_name(function)} takes one number, and is given an array of them: write it "
            f"with numpy (x**2, np.sin, np.where), or give numpy.vectorize(function)"
        ) from None
    return as_shape(found, f"{what}: what its function returns", *x.shape)


# -- solutions: (K1, K2, K3, φ0, ψ0) -----------------------------------------------------------------------------------


def _solve_three(
    phi: np.ndarray, psi: np.ndarray, input_offset: float, output_offset: float
) -> tuple[float, ...] | str:
    matrix = np.stack([np.cos(psi), -np.cos(phi), np.ones(3)], axis=1)
    if np.linalg.cond(matrix) > 1e13:
        return "the three equations do not determine the bars; choose other offsets"
    k = np.linalg.solve(matrix, np.cos(phi - psi))
    return (*map(float, k), input_offset, output_offset)


def _solve_four(x: np.ndarray, y: np.ndarray, input_offset: float | None, output_offset: float | None) -> list:
    """The determinant of K1, K2, K3, 1 is a quadratic form in cosine and sine of the offset."""
    free_input = input_offset is None

    def columns(angle: float) -> np.ndarray:
        phi = x + (angle if input_offset is None else input_offset)
        psi = y + (angle if output_offset is None else output_offset)
        return np.stack([np.cos(psi), -np.cos(phi), np.ones(4), np.cos(phi - psi)], axis=1)

    # p cos² + q cos sin + r sin², from three values.
    p, r = (np.linalg.det(columns(angle)) for angle in (0.0, 0.5 * math.pi))
    q = 2.0 * np.linalg.det(columns(0.25 * math.pi)) - p - r
    found = []
    for angle in _directions(p, q, r):
        null = np.linalg.svd(columns(angle))[2][-1]
        if abs(null[3]) < _NOTHING * np.abs(null).max():
            found.append("a root has a bar that vanishes or is infinitely long")
            continue
        k = null[:3] / -null[3]
        offsets = (angle, output_offset) if free_input else (input_offset, angle)
        found.append((*map(float, k), *offsets))
    return found


def _directions(p: float, q: float, r: float) -> list[float]:
    """Angles in (-π/2, π/2] with p cos² + q cos sin + r sin² = 0: half of those of a shifted cosine."""
    middle, size = 0.5 * (p + r), math.hypot(0.5 * (p - r), 0.5 * q)
    if size <= abs(middle):
        return []
    turn, half = math.atan2(0.5 * q, 0.5 * (p - r)), math.acos(-middle / size)
    return [0.5 * float(wrap_angle(turn + half)), 0.5 * float(wrap_angle(turn - half))]


def _solve_five(x: np.ndarray, y: np.ndarray) -> list:
    """Linear in K1 e^{iψ0}, K2 e^{iφ0}, K3, e^{i(φ0 - ψ0)}; their arguments agree where a cubic form is zero."""
    rows = np.stack(
        [np.cos(y), -np.sin(y), -np.cos(x), np.sin(x), np.ones(5), -np.cos(x - y), np.sin(x - y)], axis=1
    )  # fmt: skip
    basis = np.linalg.svd(rows)[2][-2:]

    def form(direction: np.ndarray) -> np.ndarray:
        v = direction @ basis
        k1, k2, g = v[..., 0] + 1j * v[..., 1], v[..., 2] + 1j * v[..., 3], v[..., 5] + 1j * v[..., 6]
        return (k2 * np.conj(k1) * np.conj(g)).imag

    # A cubic form c0 s³ + … + c3 t³ from its values in four directions.
    angles = np.pi * np.arange(4) / 4
    s, t = np.cos(angles), np.sin(angles)
    monomials = np.stack([s**3, s * s * t, s * t * t, t**3], axis=1)
    cubic = np.linalg.solve(monomials, form(np.stack([s, t], axis=1)))
    roots = [complex(root) for root in np.roots(cubic)]
    # an imaginary part, beside the root's size, of a root that counts as real
    directions = [(root.real, 1.0) for root in roots if abs(root.imag) <= 1e-7 * max(1.0, abs(root))]
    if abs(cubic[0]) < 1e-14 * np.abs(cubic).max():
        directions.append((1.0, 0.0))
    found = []
    for direction in directions:
        v = np.array(direction) / np.hypot(*direction) @ basis
        k1, k2, g = complex(v[0], v[1]), complex(v[2], v[3]), complex(v[5], v[6])
        if abs(g) < _NOTHING:
            found.append("a root has a bar that vanishes or is infinitely long")
            continue
        k1, k2, k3, turn = k1 / abs(g), k2 / abs(g), v[4] / abs(g), math.atan2(g.imag, g.real)
        phi0 = math.atan2(k2.imag, k2.real)
        psi0 = phi0 - turn
        first = (k1 * complex(math.cos(psi0), -math.sin(psi0))).real
        found.append(_polish_five(np.array([first, abs(k2), k3, phi0, psi0]), x, y))
    return found


def _polish_five(k: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[float, ...]:
    """Newton's steps on the five equations themselves."""
    for _ in range(3):
        phi, psi = x + k[3], y + k[4]
        rest = k[0] * np.cos(psi) - k[1] * np.cos(phi) + k[2] - np.cos(phi - psi)
        slope = np.sin(phi - psi)
        columns = [np.cos(psi), -np.cos(phi), np.ones(5), k[1] * np.sin(phi) + slope, -k[0] * np.sin(psi) - slope]
        matrix = np.stack(columns, axis=1)
        if np.linalg.cond(matrix) > 1e12:
            break
        k = k - np.linalg.solve(matrix, rest)
    return (float(k[0]), float(k[1]), float(k[2]), *(float(v) for v in wrap_angle(k[3:])))


# -- linkages ----------------------------------------------------------------------------------------------------------


def _draw_linkage(solution: tuple[float, ...] | str, x: float, y: float, ground: float) -> FourBar | str:
    """The linkage at its first precision point; a negative length is a bar that points the other way."""
    if isinstance(solution, str):
        return solution
    k1, k2, _, phi0, psi0 = solution
    sizes = abs(k1), abs(k2), 1.0
    if min(sizes) < _NOTHING * max(sizes):
        return f"K1 = {k1:.3g}, K2 = {k2:.3g}: a bar vanishes or is infinitely long"
    crank, rocker = ground / k1, ground / k2
    b = crank * np.exp(1j * (phi0 + x))
    c = ground + rocker * np.exp(1j * (psi0 + y))
    if abs(c - b) < _NOTHING * ground:
        return "the coupler has no length"  # its square, |C - B|², is never negative
    return FourBar((0.0, 0.0), (b.real, b.imag), (c.real, c.imag), (ground, 0.0))


def _move_design(linkage, solution, x, y, over, function) -> FunctionDesign:
    """Move the linkage through all precision points and over the range, from its drawing at the first point."""
    k1, k2, _, phi0, psi0 = solution
    bars = (phi0 + (math.pi if k1 < 0 else 0.0), psi0 + (math.pi if k2 < 0 else 0.0))
    grid = np.linspace(over[0], over[1], POSES)
    outputs, angles = _sweep_scale(linkage, x[0], x)
    gap = wrap_angle(outputs - bars[1] - y)
    error = float(np.abs(gap).max())
    defects = []
    if not math.isfinite(error):
        defects.append("dead point")
    elif error > 1e-9:  # radians: a precision point further off, after really moving there, is a defect
        defects.append("branch")
    found, ranged = _sweep_scale(linkage, x[0], grid)
    wanted = _call_function(function, grid, "precision_four_bars") if function is not None else None
    if not np.isfinite(found).all() and "dead point" not in defects:
        defects.append("dead point")
    structural = wrap_angle(found - bars[1] - wanted) if wanted is not None else np.zeros(0)
    every = np.concatenate([angles, ranged])
    least = float(np.min(every[np.isfinite(every)], initial=math.inf))
    return FunctionDesign(
        linkage=linkage,
        input_offset=float(wrap_angle(bars[0])),
        output_offset=float(wrap_angle(bars[1])),
        inputs=x,
        outputs=y,
        grid=grid,
        structural_error=structural,
        error=error,
        transmission=least,
        defects=tuple(defects),
    )


def _sweep_scale(linkage: FourBar, drawn: float, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rocker angles and transmission angles at values of the input scale, NaN where not reached; from the drawing."""
    a, b, *_ = linkage.z
    padded = np.concatenate([scale, np.full(POSES - len(scale), scale[-1])])  # one shape, compiled once
    motion = sweep(linkage.system, {"phi": np.angle(b - a) + padded - drawn})
    good = np.asarray(motion.converged)
    angles = np.where(good, np.asarray(transmission_angle(motion, "B", "C", "D")), np.nan)
    return np.where(good, np.asarray(motion["psi"]), np.nan)[: len(scale)], angles[: len(scale)]


def check_points(what: str, inputs: ArrayLike, outputs: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Precision points that a function was called with: arrays of one length, the inputs in order."""
    words = f"{what}: inputs and outputs must be arrays of numbers, angles in radians"
    x, y = as_floats(inputs, words), as_floats(outputs, words)
    if x.ndim != 1 or x.shape != y.shape:
        raise InputError(f"{what}: inputs {x.shape} and outputs {y.shape} must be two sequences of one length")
    for name, value in (("inputs", x), ("outputs", y)):
        if not np.isfinite(value).all():
            raise InputError(f"{what}: {name}[{int(np.argmin(np.isfinite(value)))}] is not finite")
    steps = np.diff(x)
    if not (np.all(steps > 0) or np.all(steps < 0)):
        raise InputError(f"{what}: inputs must increase (or decrease) from one precision point to the next")
    return x, y


def _as_range(name: str, over: Any) -> tuple[float, float]:
    try:
        low, high = (float(v) for v in over)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} must be a range (start, end), got {over!r}") from None
    if not (math.isfinite(low) and math.isfinite(high)) or low == high:
        raise InputError(f"{name} = ({low:g}, {high:g}) is no range; give two different finite numbers")
    return low, high
