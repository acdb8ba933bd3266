"""How far an output strays under tolerances, over the input."""

from pathlib import Path
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from jaxnc.calls import public
from jaxnc.errors import InputError
from jaxnc.viz.picture import Picture, Size, inches, save, sized
from jaxnc.viz.style import BODIES, HEADING, LIGHT, NUMBERS, furnish, named, symbol

if TYPE_CHECKING:
    from jaxnc.synthesis.tolerance.spread import Tolerance

_BARS = 8  # dimensions shown


@public
@sized
def band(
    tolerance: "Tolerance",
    name: str | None = None,
    path: str | Path | None = None,
    title: str | None = None,
    size: Size = 7.6,
    dpi: float = 200.0,
) -> Figure:
    """Draw the deviation of an output from its nominal value over the input, and who is to blame.

    Args:
        tolerance: from `jaxnc.tolerance`, over a sequence of poses.
        name: the output; the first if not given.
        path: file to write as well: PNG, SVG, PDF or JPG.
        title: heading; the mechanism and the output if not given, none if ``""``.
        size: width of the figure, inches, with the height that it needs; or width and height.
        dpi: dots per inch of a file.

    Returns:
        The figure: the band between the outer percentiles of the samples, the same percentiles to first order (of a
        normal output) as lines, the worst case dashed, and the shares of the dimensions in the variance as bars.

    Raises:
        InputError: an unknown output, or one that is not over a sequence.
        OutputError: a file that cannot be written.
    """
    name = next(iter(tolerance.outputs)) if name is None else name
    found = tolerance[name]
    if found.nominal.ndim != 1 or not tolerance.inputs:
        raise InputError(f"band: output {name!r} is not over a sequence of poses; print the table instead")
    driven, values = next(iter(tolerance.inputs.items()))
    unit = tolerance.input_units[driven]
    x, unit = (np.degrees(values), "deg") if unit == "rad" else (np.asarray(values), unit)
    factor, shown = (180.0 / np.pi, "deg") if found.unit == "rad" else (1.0, found.unit)
    figure = Picture(figsize=inches(size, lambda width: 0.44 * width), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": [2.1, 1.0]})
    off = (found.percentiles - found.nominal) * factor
    low, high = tolerance.levels[0], tolerance.levels[-1]
    left.fill_between(
        x, off[0], off[-1], color=BODIES[0], alpha=0.22, lw=0, label=f"{low:g} % … {high:g} % of the samples"
    )
    usual = [NormalDist().inv_cdf(min(max(level / 100.0, 1e-9), 1.0 - 1e-9)) for level in (low, high)]
    for sign, quantile in zip((-1.0, 1.0), usual, strict=True):
        left.plot(
            x, quantile * found.first_order * factor, color=BODIES[0], lw=1.3,
            label="the same to first order, if normal" if sign > 0 else None,
        )  # fmt: skip
        left.plot(
            x, sign * found.worst_case * factor, color=LIGHT["soft"], lw=1.0, ls=(0, (4, 3)),
            label="worst case" if sign > 0 else None,
        )  # fmt: skip
    furnish(left, "y")
    furnish(right, "x")
    left.set_xlabel(named(symbol(driven), unit))
    left.set_ylabel(named(f"deviation of {symbol(name)}", shown))
    left.margins(x=0.0)
    if unit == "deg" and np.ptp(x) >= 180.0:
        left.xaxis.set_major_locator(MultipleLocator(60.0))
    figure.legend(frameon=False, fontsize=NUMBERS, loc="outside lower left", ncols=3, handlelength=1.8)
    order = np.argsort(-found.shares, kind="stable")[:_BARS]
    order = order[found.shares[order] > 5e-4][::-1]
    right.barh(np.arange(len(order)), 100.0 * found.shares[order], color=BODIES[1], height=0.62)
    right.set_yticks(np.arange(len(order)), [tolerance.variables[k] for k in order])
    right.set_xlabel("share of the variance [%]")
    heading = f"{tolerance.name}: tolerances and {name}" if title is None else title
    if heading:
        left.set_title(heading, loc="left", fontsize=HEADING, color=LIGHT["ink"], parse_math=False)
    if path is not None:
        save(figure, path, dpi)
    return figure
