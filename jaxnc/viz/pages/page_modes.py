"""Start poses of a page: all assemblies at some inputs, from which the page finds those at any."""

from typing import Any

import numpy as np

from jaxnc.errors import InputError
from jaxnc.kinematics.modes import Modes, ModesMap, modes
from jaxnc.kinematics.motion import Motion
from jaxnc.solvers.plan import Plan
from jaxnc.viz.pages.packing import round_numbers
from jaxnc.viz.poses import evenly

_VALUES = 36  # sets of inputs that are solved for a page: every 10° of a turn
_NUMBERS = 5000  # that a page may have of them, 50 kB


def page_modes(motion: Motion, view: Plan, given: "bool | Modes | ModesMap") -> list[dict[str, Any]]:
    """List inputs, and the unknowns of every assembly there; those of a motion's inputs where True is given."""
    found = given
    if given is True:
        asked = np.unique(np.asarray(motion.asked, float).reshape(-1, len(motion.driven)), axis=0)
        inputs = dict(zip(motion.driven, evenly(asked, _VALUES).T, strict=True))
        found = modes(motion.system, inputs, hold=motion.held, unit="rad")
    if not isinstance(found, Modes | ModesMap):
        raise InputError(f"modes= takes True, or what jaxnc.modes found of this mechanism, got {type(found).__name__}")
    poses, top = found.poses, motion.system.topology
    if poses.system.topology != top or poses.system.parameters.points.ndim > 2:
        raise InputError(f"modes= takes assemblies of {top.name!r} and of one design, as jaxnc.modes finds them")
    if set(poses.driven) != set(motion.driven) or set(poses.held) != set(motion.held):
        raise InputError(
            f"modes= takes assemblies of {top.name!r} for the inputs of the motion, {', '.join(motion.driven)}, got "
            f"such for {', '.join(poses.driven) or 'no input'}; modes=True finds them"
        )
    q, good = np.asarray(poses.q, float), np.asarray(poses.converged)
    q, good = (a.reshape(-1, good.shape[-1], *a.shape[good.ndim :]) for a in (q, good)) if good.size else (q[:0], good)
    most = max(1, _NUMBERS // max(1, len(view.unknown) * int(good.sum(axis=-1).max(initial=0))))
    return [
        {"asked": [float(x) for x in some[0, list(view.driven)]], "q": round_numbers(some[:, view.unknown])}
        for some in (q[k, good[k]] for k in evenly(np.arange(len(q)), most))
        if len(some)
    ]
