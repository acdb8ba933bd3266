"""Runs through the library with the shapes in signatures checked: prints which functions were asked, as JSON."""

import json

import jax
import jax.numpy as jnp
import jaxtyping
import numpy as np
import shape_check  # before the library: it puts the hook in

import jaxnc as nc
from jaxnc.solvers import dense
from jaxnc.system.equations import equations, jacobian, residual

jax.config.update("jax_enable_x64", True)

four_bar = nc.library.four_bar().compile()
angles = np.linspace(0.0, 2.0, 5)

# Poses and rates, on the host and traced (shapes are asked for while a program is made, so none is compiled); all
# equations of a design.
swept = nc.sweep(four_bar, {"phi": angles}, rates={"phi": 1.0})
swept.velocity("B"), swept.singular_values
jax.jit(lambda s: nc.sweep(s, {"phi": angles}, rates={"phi": 1.0}).q).lower(four_bar)
jax.jit(jax.grad(lambda s: jax.vmap(lambda a: nc.solve_position(s, {"phi": a})["B"][0])(angles).sum())).lower(four_bar)
eq = jax.jit(equations)(four_bar)
residual(eq, swept.q[0]), jacobian(eq, swept.q[0])
nc.solve_position(four_bar, {"phi": angles}, start={"B": np.asarray(swept["B"])})

# Space: frames, markers, a wheel, its sensitivities.
strut = nc.library.macpherson().compile()
ride = nc.sweep(strut, {"6.z": np.linspace(270.0, 350.0, 3)}, hold=("10.y", "7.x"), rates={"6.z": 1.0})
nc.suspension(ride)

# Dynamics.
pendulum = nc.Mechanism("pendulum")
pendulum.ground("O", (0.0, 0.0))
pendulum.point("A", (1.0, 0.0))
pendulum.body("rod", ["O", "A"])
pendulum.point_mass("mass at A", "A", 1.0)
pendulum.gravity = (0.0, -9.81)
fall = nc.simulate(pendulum.compile(), np.linspace(0.0, 0.1, 3), method="rk4")
fall.energy, nc.dynamics.momentum(fall), nc.dynamics.centre_of_mass(fall)

# Linear algebra, by itself and mapped.
a = jnp.array([[2.0, 0.3], [0.1, 1.0]])
for f in (dense.singular_values, dense.conditioning, dense.determinant_sign):
    f(a), jax.vmap(f)(jnp.stack([a, 2 * a]))
dense.newton_steps(a, jnp.ones((2, 1)))

refused = ""
try:
    dense.newton_steps(a, jnp.ones((3, 1)))
except jaxtyping.TypeCheckError as error:
    refused = str(error)
print(json.dumps([sorted(shape_check.seen), refused]))
