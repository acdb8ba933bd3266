"""The ratios of a run: what is compared with the baseline, and what the library has set out to reach."""

import math
from collections.abc import Callable

from benchmarks.record import OURS, Ratio, Record, Row

NAIVE = "naive JAX, 8 steps"
_LOOSE = 0.4  # relative tolerance of a ratio of two times on a shared machine
_FOUR, _ROW = "four-bar", "row of four-bars, {}, {} coordinates"
_STEP = _ROW.format("Newton step", "10,000")
_HAND2, _HAND4, _SIMD4 = "JAX by hand, n = 2", "JAX by hand, n = 4", "C Newton, 8 lanes, n = 4"
_TURNED, _RENAMED, _OWN = (f"jaxnc: {x}" for x in ("turned", "renamed and permuted", "of a kind defined outside"))
_NARROW = "jaxnc: float32"
_SWEEP, _ENSEMBLE = "jaxnc: sweep", "pylinkage Ensemble"
_GRADIENT, _HESSIAN = "jaxnc: value and gradient", "jaxnc: Hessian-vector product"
_TEN, _TEN_GRADIENT = "jaxnc: ten seconds", "jaxnc: and their gradient"

# Name; case and way whose time is divided; case and way whose time it is divided by; better direction; target.
_TIMES: tuple[tuple[str, tuple[str, str], tuple[str, str], str, float | None], ...] = (
    ("four-bar: jaxnc / JAX by hand, n = 2", (_FOUR, OURS), (_FOUR, _HAND2), "lower", 1.6),
    ("four-bar: jaxnc / JAX by hand, n = 4", (_FOUR, OURS), (_FOUR, _HAND4), "lower", None),
    ("four-bar: naive JAX, n = 2 / jaxnc", (_FOUR, "naive JAX, n = 2"), (_FOUR, OURS), "higher", 40.0),
    ("four-bar: naive JAX, n = 4 / jaxnc", (_FOUR, "naive JAX, n = 4"), (_FOUR, OURS), "higher", 40.0),
    ("four-bar: optimistix / jaxnc", (_FOUR, "optimistix Newton, n = 4"), (_FOUR, OURS), "higher", None),
    ("four-bar: numba Newton / jaxnc", (_FOUR, "numba Newton, n = 4"), (_FOUR, OURS), "higher", None),
    ("four-bar: pylinkage step_fast / jaxnc", (_FOUR, "pylinkage step_fast"), (_FOUR, OURS), "higher", 3.0),
    ("four-bar: SciPy loop / jaxnc", (_FOUR, "SciPy fsolve loop, n = 2"), (_FOUR, OURS), "higher", None),
    ("four-bar: jaxnc / C, 8 lanes, n = 4", (_FOUR, OURS), (_FOUR, _SIMD4), "lower", 2.5),
    ("four-bar: jaxnc / C, 8 lanes, n = 2", (_FOUR, OURS), (_FOUR, "C Newton, 8 lanes, n = 2"), "lower", None),
    ("four-bar: random order / in order", ("four-bar-random", OURS), (_FOUR, OURS), "lower", None),
    ("guises: turned / plain", ("guises", _TURNED), ("guises", OURS), "lower", 1.2),
    ("guises: renamed and permuted / plain", ("guises", _RENAMED), ("guises", OURS), "lower", 1.2),
    ("guises: kind from outside / plain", ("guises", _OWN), ("guises", OURS), "lower", 1.2),
    ("designs: pylinkage Ensemble / jaxnc", ("designs", _ENSEMBLE), ("designs", OURS), "higher", 3.0),
    (
        "designs: pylinkage Ensemble / jaxnc sweep",
        ("designs", _ENSEMBLE),
        ("designs", _SWEEP),
        "higher",
        3.0,
    ),
    ("designs: jaxnc sweep / lanes", ("designs", _SWEEP), ("designs", OURS), "lower", None),
    ("generic: naive JAX / jaxnc", ("generic", "naive JAX"), ("generic", OURS), "higher", 20.0),
    ("macpherson: naive JAX / jaxnc", ("macpherson", "naive JAX"), ("macpherson", OURS), "higher", 20.0),
    ("value and gradient / value", ("derivatives", _GRADIENT), ("derivatives", OURS), "lower", 2.0),
    ("Hessian-vector product / value", ("derivatives", _HESSIAN), ("derivatives", OURS), "lower", 6.0),
    ("simulation: gradient / value", ("soft joints", _TEN_GRADIENT), ("soft joints", _TEN), "lower", 3.0),
    ("four-bar: float32 / float64", ("widths four-bar", _NARROW), ("widths four-bar", OURS), "lower", None),
    ("macpherson: float32 / float64", ("widths MacPherson", _NARROW), ("widths MacPherson", OURS), "lower", None),
    ("devices: one / two", ("devices: one only", OURS), ("devices", OURS), "higher", 1.8),
    ("devices: one on one core / two", ("devices: one on one core", OURS), ("devices", OURS), "higher", None),
    ("devices: one / two, JAX by hand", ("devices: one only", _HAND2), ("devices", _HAND2), "higher", None),
)

_NUMPY = "import numpy"
for _name in ("four-bar", "Jansen", "MacPherson"):
    _case = f"first answers, {_name}"
    for _step in ("compile", "first sweep", "second sweep"):
        _TIMES += ((f"{_case}: {_step} / {_NUMPY}", (_case, f"jaxnc: {_step}"), (_case, _NUMPY), "lower", None),)
_LINKAGES = "first answers, linkages"
_TIMES += ((f"{_LINKAGES} / {_NUMPY}", (_LINKAGES, "jaxnc: all"), (_LINKAGES, _NUMPY), "lower", None),)

# Name; case; way; number; target.
_ABSOLUTE: tuple[tuple[str, str, str, Callable[[Row], float | None], float], ...] = (
    ("four-bar: ns per angle, one core", _FOUR, OURS, lambda r: r.median_ns_per_lane, 60.0),
    ("macpherson: µs per pose, one core", "macpherson", OURS, lambda r: r.median_ns_per_lane / 1e3, 4.0),
    ("value and gradient: ns per lane", "derivatives", _GRADIENT, lambda r: r.median_ns_per_lane, 150.0),
    ("single pose from Python, µs", "single", OURS, lambda r: r.median_ns_per_lane / 1e3, 1000.0),
    ("single pose from the one before, µs", "single", f"{OURS}: start=", lambda r: r.median_ns_per_lane / 1e3, 100.0),
    ("row of 10,000 coordinates: ms per Newton step", _STEP, OURS, lambda r: r.median_ns_per_lane / 1e6, 5.0),
    *(
        (f"{name}: {step}, ms", f"first answers, {name}", f"jaxnc: {step}", lambda r: r.median_ns_per_lane / 1e6, reach)
        for name, made, swept in (("four-bar", 30.0, 50.0), ("Jansen", 40.0, 70.0), ("MacPherson", 150.0, 300.0))
        for step, reach in (("compile", made), ("first sweep", swept))
    ),
    ("50 small linkages, s", _LINKAGES, "jaxnc: all", lambda r: r.median_ns_per_lane / 1e9, 5.0),
    ("compile of the four-bar, s", "compile four-bar", OURS, lambda r: r.compile_s, 1.5),
    ("compile of the MacPherson, s", "compile MacPherson", OURS, lambda r: r.compile_s, 6.0),
)


def ratios(record: Record) -> list[Ratio]:
    """All ratios that the rows of a record allow, in a fixed order."""
    return [*_times(record), *_growth(record), *_classes(record), *_right(record), *_absolute(record)]


def _times(record: Record) -> list[Ratio]:
    out = []
    for name, above, below, direction, target in _TIMES:
        a, b = record.find(*above), record.find(*below)
        if a is not None and b is not None:
            out.append(Ratio.of(name, a.median_ns_per_lane / b.median_ns_per_lane, direction, _LOOSE, target))
    return out


def _growth(record: Record) -> list[Ratio]:
    """Exponents of cost in the number of coordinates: 1 is linear."""
    out = []
    for low, high in (("100", "1,000"), ("1,000", "10,000")):
        a, b = (record.find(_ROW.format("one pose", n), OURS) for n in (low, high))
        if a is not None and b is not None:
            exponent = math.log10(b.median_ns_per_lane / a.median_ns_per_lane)
            target = 1.15 if high == "10,000" else None
            out.append(Ratio.of(f"row: exponent of growth, {low} to {high}", exponent, "lower", 0.2, target))
    return out


def classes(record: Record) -> list[str]:
    """The cases that are a class of mechanism at one size."""
    return [case for case in dict.fromkeys(r.case for r in record.rows) if case.startswith("class ")]


def _classes(record: Record) -> list[Ratio]:
    """How many times quicker than naive steps each class is, and what a gradient costs."""
    out = []
    pairs = (
        ("naive JAX / jaxnc", NAIVE, OURS, "higher", 2.0),
        ("naive JAX / jaxnc in jit", NAIVE, f"{OURS}: jit", "higher", 2.0),
        ("value and gradient / value", _GRADIENT, f"{OURS}: value", "lower", 2.5),
    )
    for case in classes(record):
        for name, above, below, direction, target in pairs:
            a, b = record.find(case, above), record.find(case, below)
            if a is not None and b is not None:
                value = a.median_ns_per_lane / b.median_ns_per_lane
                out.append(Ratio.of(f"{case}: {name}", value, direction, _LOOSE, target))
    return out


def _right(record: Record) -> list[Ratio]:
    """The fraction of right lanes of everything of ours: it may not fall at all."""
    out = []
    for case in dict.fromkeys(r.case for r in record.rows):
        known = [r.correct for r in record.rows if r.case == case and r.way.startswith(OURS) and r.correct is not None]
        if known:
            out.append(Ratio.of(f"{case}: right lanes of jaxnc", min(known), "higher", 0.0, 1.0))
    return out


def _absolute(record: Record) -> list[Ratio]:
    """Times with a target of their own: shown, never compared with the baseline."""
    out = []
    for name, case, way, number, target in _ABSOLUTE:
        row = record.find(case, way)
        value = None if row is None else number(row)
        if value is not None:
            out.append(Ratio.of(name, value, "lower", None, target))
    return out
