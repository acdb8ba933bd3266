"""Prescribed motions against rows on velocities, which positions do not see."""

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.system.rates import rate_constants, slips

_SLIPS = 1e-6  # of the largest rate: below, a motion rolls


def rolls(motion: Motion) -> Motion:
    """A motion in time, refused where its velocities break a row on velocities; unchecked in traced code."""
    top = motion.system.topology
    if not top.rates or not motion.rates or isinstance(motion.q, Tracer) or isinstance(motion.rates[0], Tracer):
        return motion
    constants = rate_constants(motion.system)
    off = np.abs(np.asarray(jax.vmap(lambda q, v: slips(top, constants, q, v))(motion.q, motion.rates[0])))
    off = np.where(np.asarray(motion.status == 0)[:, None], off, 0.0)
    pose, row = np.unravel_index(int(off.argmax()), off.shape)
    if off[pose, row] > _SLIPS * float(jnp.max(jnp.abs(motion.rates[0]))):
        raise InputError(
            f"{top.name!r}: the prescribed velocities break {top.rate_rows[row]!r} by {off[pose, row]:.3g} in pose "
            f"{pose}. Positions do not see rows on velocities, so a sweep without rates goes anywhere; prescribe a "
            f"motion that rolls, or fewer coordinates in simulate(inputs=), where the rows decide the others"
        )
    return motion
