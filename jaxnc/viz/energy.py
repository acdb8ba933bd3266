"""Energies of a motion over time, what they came from and went to, and the error of the balance."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from jaxnc.calls import public
from jaxnc.dynamics.balance import energy_balance
from jaxnc.kinematics.motion import Motion
from jaxnc.viz.picture import Size, save, sized
from jaxnc.viz.plots import layout
from jaxnc.viz.style import BODIES, LIGHT, LINES, crown


@public
@sized
def plot_energy(
    motion: Motion, path: str | Path | None = None, title: str | None = None, size: Size = 6.4, dpi: float = 200.0
) -> Figure:
    """Plot kinetic and potential energy and their sum; what came in and was taken; and the error of the balance.

    Args:
        motion: a simulation, or a motion in time that carries velocities.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism's name if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure; times that were not reached are gaps.

    Raises:
        InputError: a motion without time or velocities, or a batch.
        OutputError: a file that cannot be written.
    """
    found = energy_balance(motion)
    t = found.time
    work = {"inputs": found.inputs, "loads": found.loads, "dampers": -found.dissipated, "friction": -found.friction}
    work = {name: x for name, x in work.items() if np.nanmax(np.abs(x), initial=0.0) > 0}
    figure, axes = layout(3 if work else 2, size)
    for ax, what, rows in (
        (axes[0], "energy [J]", {"kinetic": found.kinetic, "potential": found.potential}),
        (axes[1], "work since the start [J]", work),
    ):
        for colour, dashes, (name, e) in zip(BODIES, LINES, rows.items(), strict=False):
            ax.plot(t, e, color=colour, linestyle=dashes, linewidth=1.4, label=name)
        if rows and ax is axes[0]:
            ax.plot(t, found.total, color=LIGHT["ink"], linewidth=1.4, label="total")
        if rows:
            ax.set_ylabel(what)
    axes[-1].plot(t, found.error, color=LIGHT["ink"], linewidth=1.2)
    axes[-1].set_ylabel("error of the balance [J]")
    axes[-1].set_xlabel("time [s]")
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    heading = motion.system.name if title is None else title
    for ax in axes:
        crown(ax, heading if ax is axes[0] else "")
    if path is not None:
        save(figure, path, dpi)
    return figure
