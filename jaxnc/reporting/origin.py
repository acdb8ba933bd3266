"""Where a report comes from: what made it, of which model, and a few digits that another run has to agree with."""

import hashlib
import platform
from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed

import jax
import numpy as np

from jaxnc.exports import version
from jaxnc.io.files import plain
from jaxnc.io.layout import json_text, toml
from jaxnc.kinematics.hardpoints import trade_names
from jaxnc.kinematics.motion import Motion
from jaxnc.mechanism import Mechanism

_POSES = 3  # whose digits are told


def model_text(mechanism: Mechanism) -> str:
    """A mechanism as the model file that `Mechanism.save` writes."""
    model = mechanism.model
    named = trade_names((*model.ground, *model.points, *model.ground_vectors, *model.vectors, *model.markers))
    return toml(plain(model), named)


def origin(mechanism: Mechanism | None, motion: Motion | None, said: str) -> dict[str, str]:
    """Versions, digests and settings, each in a line."""
    out = {"jaxnc": version()}
    for name in ("jax", "jaxlib", "numpy", "scipy"):
        try:
            out[name] = installed(name)
        except PackageNotFoundError:
            out[name] = "not known"
    out["python"] = f"{platform.python_version()} ({platform.python_implementation()})"
    out["platform"] = platform.platform()
    out["numbers"] = "64 bit" if jax.config.jax_enable_x64 else "32 bit"  # pyright: ignore[reportAttributeAccessIssue]
    if mechanism is not None:
        canonical = json_text(plain(mechanism.model)).encode()
        out["model, SHA-256"] = hashlib.sha256(canonical).hexdigest()
    if said:
        out["file, SHA-256"] = hashlib.sha256(said.encode()).hexdigest()
    if motion is not None and motion.status.ndim == 1:
        good = np.asarray(motion.converged)
        out["poses"] = (
            f"{len(good)}, each corrected by Newton's method until its residual is rounding; no random numbers"
        )
        if good.any() and motion.residual is not None:
            out["worst residual"] = (
                f"{np.asarray(motion.residual)[good].max():.3g} {motion.system.topology.length_unit}"
            )
    out["seeds"] = "fixed: 7 and 8 (poses near the drawing, for the rank), 3 (a general change of its dimensions)"
    return out


def digits(motion: Motion) -> list[list[str]]:
    """All moving coordinates of a few poses to the last digit, radians and lengths: a heading and a row for each."""
    top = motion.system.topology
    good = np.flatnonzero(np.asarray(motion.converged).reshape(-1))
    if not len(good):
        return []
    chosen = list(dict.fromkeys(good[[0, len(good) // 3, 2 * len(good) // 3, -1]].tolist()))[:_POSES]
    q = np.asarray(motion.q).reshape(-1, len(top.coordinates))
    names = [n for n in (*top.scalars, *top.coordinates[: -len(top.scalars) or None]) if _moves(motion, n)]
    rows = [["coordinate", *(f"pose {k}" for k in chosen)]]
    for name in dict.fromkeys([*motion.driven, *names]):
        rows.append([name, *(repr(float(q[k, top.position[name]])) for k in chosen)])
    return rows


def _moves(motion: Motion, name: str) -> bool:
    top = motion.system.topology
    k = top.position[name]
    return k >= len(top.fixed) or not top.fixed[k]
