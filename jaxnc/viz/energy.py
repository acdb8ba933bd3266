"""Energies of a motion over time: kinetic, potential and their sum."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxnc.dynamics.energy import kinetic_energy, potential_energy
from jaxnc.errors import InputError
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.picture import save
from jaxnc.viz.plots import layout
from jaxnc.viz.style import BODIES, LIGHT

_TEXT = 9.0  # points


def plot_energy(
    motion: Motion, path: str | Path | None = None, title: str | None = None, width: float = 6.4, dpi: float = 200.0
) -> Figure:
    """Plot kinetic and potential energy, their sum, and how far the sum has drifted.

    Args:
        motion: a simulation, or a motion in time that carries velocities.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name if not given, none if ``""``.
        width: width of the figure, inches.
        dpi: dots per inch of a file.

    Returns:
        The figure; times that were not reached are gaps.

    Raises:
        InputError: a motion without time or velocities, or a batch.
        OutputError: a file that cannot be written.
    """
    if motion.time is None or motion.status.ndim != 1:
        raise InputError("plot_energy() wants one motion in time: of nc.simulate(), or of nc.motion(system, inputs, t)")
    t, bad = np.asarray(motion.time), np.asarray(motion.status) != 0
    parts = {"kinetic": kinetic_energy(motion), "potential": potential_energy(motion)}
    values = {name: np.where(bad, np.nan, np.asarray(e)) for name, e in parts.items()}
    total = values["kinetic"] + values["potential"]
    figure, axes = layout(2, width)
    for (name, e), colour in zip(values.items(), BODIES, strict=False):
        axes[0].plot(t, e, color=colour, linewidth=1.4, label=name)
    axes[0].plot(t, total, color=LIGHT["ink"], linewidth=1.4, label="total")
    axes[0].set_ylabel("energy [J]", fontsize=_TEXT)
    axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False, fontsize=_TEXT - 1)
    axes[1].plot(t, total - total[0], color=LIGHT["ink"], linewidth=1.2)
    axes[1].set_ylabel("change of the total [J]", fontsize=_TEXT)
    axes[1].set_xlabel("time [s]", fontsize=_TEXT)
    axes[0].tick_params(labelbottom=False)
    heading = motion.system.name if title is None else title
    if heading:
        axes[0].set_title(heading, loc="left", fontsize=_TEXT + 1, color=LIGHT["ink"], parse_math=False)
    if path is not None:
        save(figure, path, dpi)
    return figure
