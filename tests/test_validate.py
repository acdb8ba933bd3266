"""What is wrong with a function that a user has written is said by what it is for."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.constraints import Kind, RateKind
from jaxnc.forces import ForceKind
from jaxnc.validate import as_array

NO_NUMBER = r"the lambda \(test_validate.py, line \d+\) needs a number where JAX has none yet.* jax.numpy"
IDEA = nc.library.four_bar()
SYSTEM = IDEA.compile()
TIMES = np.linspace(0.0, 0.1, 3)


def _rod(add) -> nc.System:
    m = nc.Mechanism("rod")
    m.ground("O", (0, 0))
    m.point("P", (1, 0.5))
    m.body("rod", ["O", "P"], mass=1.0)
    m.angle("phi", at="O", to="P")
    add(m)
    return m.compile()


def _sensitivity(f):
    nc.sensitivity(SYSTEM, f, {"phi": 1.2})


def _tolerance(f):
    nc.tolerance(SYSTEM, {"phi": 1.2}, {"mine": f}, {"B": 1e-4}, samples=2)


def _robust(f):
    nc.synthesis.robust(SYSTEM, {"phi": 1.2}, f, {"B": 1e-4}, samples=2)(SYSTEM)


def _objective(f):
    nc.synthesis.Objective(IDEA, f, np.linspace(1.0, 1.2, 3))


def _motion(f):
    nc.motion(SYSTEM, {"phi": f}, TIMES)


def _driven(f):
    nc.simulate(_rod(lambda m: m.point_mass("mass at P", "P", 1.0)), TIMES, inputs={"phi": f})


def _torque(f):
    nc.simulate(_rod(lambda m: m.torque("effort on phi", "phi", f)), TIMES)


def _event(f):
    nc.simulate(_rod(lambda m: None), TIMES, event=f)


def _residual(f):
    _rod(lambda m: m.constrain("mine", Kind("mine", f, points=1), ["P"]))


def _drawn(f):
    _rod(
        lambda m: m.constrain(
            "mine", Kind("mine", lambda p, v, s, c: [c[0]], points=1, constants=("a",), drawn=f), ["P"]
        )
    )


def _rate(f):
    nc.simulate(_rod(lambda m: m.constrain("mine", RateKind("mine", f, points=1), ["P"])), TIMES)


_ROOT = ForceKind("mine", points=1, potential=lambda p, v, s, c: jnp.sqrt(-1.0 - p[0, 0] ** 2))


def _applied(**what):
    nc.simulate(_rod(lambda m: m.apply("mine", ForceKind("mine", points=1, **what), points=["P"])), TIMES)


REFUSED = {
    "nothing": (lambda: _sensitivity(lambda mo: None), "outputs=: the lambda must return an array, .*it returned None"),
    "none of several": (lambda: _tolerance(lambda mo: {}), "output 'mine': the lambda must return an array"),
    "NumPy": (lambda: _sensitivity(lambda mo: np.sin(mo["C"])), "outputs=: " + NO_NUMBER),
    "an if": (lambda: _tolerance(lambda mo: 1.0 if mo["C"][0] > 0 else 0.0), "output 'mine': " + NO_NUMBER),
    "float": (lambda: _robust(lambda mo: float(mo["C"][0])), "outputs=: " + NO_NUMBER),
    "no argument": (lambda: _sensitivity(lambda: 1.0), r"outputs=: the lambda must take \(motion\)"),
    "math": (lambda: _objective(lambda mo: math.sin(mo["C"][0, 0])), "Objective: residual .*" + NO_NUMBER),
    "complex": (lambda: _objective(lambda mo: mo["C"] + 1j), "Objective: residual .* complex ones: take jnp.real"),
    "no numbers": (lambda: _objective(lambda mo: mo["C"][:0]), "arrays of no numbers, and there is nothing to make"),
    "a complex law": (lambda: _motion(lambda t: t + 1j), "input 'phi': its function of time must return .* complex"),
    "a law of math": (lambda: _motion(lambda t: math.sin(t)), "input 'phi': " + NO_NUMBER),
    "a driven law": (lambda: _driven(lambda t: math.sin(t)), "input 'phi': " + NO_NUMBER),
    "a law of nothing": (lambda: _driven(lambda: 1.0), r"input 'phi': the lambda must take \(t\)"),
    "a complex torque": (lambda: _torque(lambda t, x, p: 1j), "force 'effort on phi' must return one number .*complex"),
    "a short torque": (lambda: _torque(lambda t, x: 1.0), r"the lambda must take \(t, state, parameters\)"),
    "a torque with an if": (lambda: _torque(lambda t, x, p: 1.0 if x["phi"] > 0 else 0.0), NO_NUMBER),
    "an event of nothing": (lambda: _event(lambda t, x: None), "event= must return one number, which changes its sign"),
    "a true event": (lambda: _event(lambda t, x: x["phi"] > 0), "event= returned true or false"),
    "a short event": (lambda: _event(lambda t: t), r"event=: the lambda must take \(t, state\)"),
    "no row": (
        lambda: _residual(lambda p, v, s, c: p[0, 0]),
        r"kind 'mine': residual= must return a list of one .*\[x\]",
    ),
    "two rows": (lambda: _residual(lambda p, v, s, c: [p[0, 0], p[0, 1]]), "residual= must return .*; it returned 2"),
    "a text": (lambda: _residual(lambda p, v, s, c: ["x"]), "residual= .*number 0 of what it returned is str 'x'"),
    "a row of math": (lambda: _residual(lambda p, v, s, c: [math.sin(p[0, 0])]), "'mine': residual=: " + NO_NUMBER),
    "short rows": (lambda: _residual(lambda p: [p[0, 0]]), r"residual=: the lambda must take \(p, v, s, c\)"),
    "nothing drawn": (lambda: _drawn(lambda p, v, s, c: None), "kind 'mine': drawn= must return a list"),
    "no rate": (lambda: _rate(lambda p, v, s, dp, dv, ds, c: None), "kind 'mine': rate= must return a list"),
    "no energy": (
        lambda: _applied(potential=lambda p, v, s, c: p[0]),
        "kind 'mine': potential= must return one number",
    ),
    "no loss": (
        lambda: _applied(dissipation=lambda p, v, s, dp, dv, ds, c: None),
        "dissipation= must return one number",
    ),
    "a parameter too many": (
        lambda: _applied(potential=lambda p, v, s, c: c[1] * p[0, 0], parameters=("k",), drawn=lambda p, v, s: (1.0,)),
        "kind 'mine' asks for index 1 in an array of 1: it declares points=1, .* 1 parameters; declare",
    ),
    "no finite force": (
        lambda: nc.equilibrium(_rod(lambda m: m.apply("mine", _ROOT, points=["P"]))),
        "force 'mine' is not finite where the search begins",
    ),
    "half a force": (
        lambda: _applied(force=lambda t, p, v, s, dp, dv, ds, c: [1.0]),
        "kind 'mine': force= .* 2 numbers",
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_functions_that_a_user_has_written_are_blamed_by_what_they_are_for(what):
    call, said = REFUSED[what]
    with pytest.raises(nc.InputError, match=said):
        call()


def test_errors_of_a_function_itself_pass_through():
    with pytest.raises(KeyError, match="no such table"):
        _motion(lambda t: {}["no such table"])
    with pytest.raises(TypeError, match="unsupported operand"):
        _sensitivity(lambda mo: mo["C"] + jnp.zeros(2) + object())


@pytest.mark.parametrize(
    ("function", "given", "said"),
    [
        (IDEA.compile, {"redundancy": "independent rows"}, r"redundancy= .*sweep\(system"),
        (IDEA.compile, {"spars": True}, "no spars=; did you mean 'sparse'"),
        (nc.simulate, {"hold": ["phi"]}, r"hold= is .*inputs=\{'phi': lambda t: 0\.7\}"),
        (nc.linearise, {"hold": ["phi"]}, r"hold= is of poses and equilibria: .*mechanism\.weld\("),
        (nc.equilibrium, {"inputs": {"phi": 0.7}}, "no inputs=; did you mean 'hold'"),
    ],
)
def test_arguments_that_a_function_does_not_take_are_named(function, given, said):
    with pytest.raises(nc.CallError, match=said):
        function(**given)


_LISTS = {
    "a place": lambda y: nc.solve_position(SYSTEM.replace({"B": (0.01, y)}), {"phi": 1.2})["C"][0],
    "an input": lambda y: nc.sweep(SYSTEM, {"phi": [1.1, y + 1.1]})["C"][-1, 0],
    "a rate": lambda y: nc.sweep(SYSTEM, {"phi": [1.1, 1.2]}, rates={"phi": (y, 1.0)}).velocity("C")[0, 0],
    "a law in arrays": lambda y: nc.motion(SYSTEM, {"phi": ([1.1, y + 1.1], [0, 0], [0, 0])}, [0.0, 0.1])["C"][-1, 0],
    "times": lambda y: nc.motion(SYSTEM, {"phi": lambda t: 1.0 + t}, [0.0, y])["C"][-1, 0],
}


@pytest.mark.parametrize("what", _LISTS)
def test_a_list_may_hold_what_is_traced(what):
    f, y, h = _LISTS[what], 0.1, 1e-5
    np.testing.assert_allclose(jax.grad(f)(y), (f(y + h) - f(y - h)) / (2 * h), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(jax.jit(f)(y), f(y), rtol=1e-9)


def test_a_start_may_hold_what_is_traced_and_what_is_no_number_is_still_refused():
    def near(y):
        return nc.solve_position(SYSTEM, {"phi": 1.2}, start={"C": (y, 0.1)})["C"]

    np.testing.assert_allclose(jax.jit(near)(0.1), near(0.1), atol=1e-12)
    for wrong in ((None, 0.1), (1j, 0.1), ((1.0,), 0.1)):
        with pytest.raises(nc.InputError, match="'B' must be a number or an array of numbers"):
            jax.jit(lambda y, wrong=wrong: SYSTEM.replace({"B": (wrong[0], y)})["B"])(0.1)
    with pytest.raises(nc.InputError, match="room= must be known, and JAX traces it"):
        jax.jit(lambda y: as_array([y, 1.0], "room="))(0.1)
