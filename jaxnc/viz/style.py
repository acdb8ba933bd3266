"""How each part of a drawing looks: one table of roles, one palette, one way of furnishing axes."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from matplotlib.axes import Axes

HEADING, TEXT, NUMBERS = 10.0, 9.0, 8.0
"""Sizes of letters in figures, points: of headings, of the names of axes, of numbers and legends."""


GRID = "#e3e6ea"
"""Colour of the lines of a grid."""

INK = -1
"""Colour index of lines that belong to no body."""


@dataclass(frozen=True)
class Style:
    """Look of one role."""

    stroke: str = ""  # colour of the line: "body", "ink", "soft" (a lighter ink), "paper", or none
    width: float = 0.0  # width of the line, in units (the radius of a joint is one unit)
    fill: str = ""  # colour of the area: as `stroke`, or "tint", the body's colour mixed with the paper
    opacity: float = 1.0  # opacity of the area
    dash: tuple[float, ...] = ()  # lengths of dashes and gaps, in units
    layer: int = 0  # what lies on top of what
    fixed: bool = False  # whether it belongs to the ground, and stays as it is when a pose is not right


ROLES = {
    "hatch": Style("soft", 0.16, layer=0, fixed=True),
    "guide": Style("ink", 0.28, layer=1, fixed=True),
    "support": Style("ink", 0.28, "paper", layer=1, fixed=True),
    "annulus": Style("body", 0.3, layer=2),
    "wheel": Style("body", 0.26, "body", 0.10, (2.4, 0.7, 0.4, 0.7), layer=2),
    "disc": Style("body", 0.38, "body", 0.14, layer=2),
    "reference": Style("soft", 0.16, dash=(1.0, 0.7), layer=3),
    "centre line": Style("soft", 0.2, dash=(2.4, 0.7, 0.4, 0.7), layer=3),
    "cable": Style("ink", 0.22, dash=(1.4, 0.9), layer=4),
    "plate": Style("body", 0.62, "body", 0.24, layer=5),
    "casing": Style("paper", 1.9, layer=6),  # keeps crossing bars apart
    "bar": Style("body", 1.06, layer=6),
    "slotted bar": Style("body", 2.7, layer=7),
    "channel": Style("paper", 1.75, layer=8),
    "rod": Style("ink", 0.5, layer=7),
    "cylinder": Style("ink", 0.26, "paper", layer=8),
    "spring": Style("ink", 0.32, layer=8),
    "dashpot": Style("ink", 0.3, layer=8),
    "torque": Style("applied", 0.34, layer=12),
    "torque head": Style("", 0.0, "applied", layer=12),
    "block": Style("ink", 0.28, "tint", layer=9),
    "arc": Style("soft", 0.2, layer=10),
    "dot": Style("paper", 0.16, "body", layer=10),
    "pin": Style("ink", 0.3, "paper", layer=11),
    "ground pin": Style("ink", 0.3, "paper", layer=11, fixed=True),
    "marker": Style("ink", 0.24, layer=12),
    "pole": Style("paper", 0.16, "ink", layer=13),
    "ring": Style("ink", 0.24, "paper", layer=13),
    "image": Style("body", 0.5, "body", 0.14, layer=5),
    "vector": Style("soft", 0.0, layer=4),
    "radius": Style("soft", 0.18, layer=4),
    "inflection": Style("body", 0.3, dash=(1.5, 0.8), layer=4),
    "tangential": Style("soft", 0.26, dash=(0.5, 0.5), layer=4),
}
"""Style of every role, from the ground up."""

BODIES = ("#2f6db3", "#d9772b", "#2f8f6b", "#b8405e", "#7a5bb0", "#a07a1f", "#2394a8", "#c65b9c", "#6b7f2a", "#8a5a44")
"""Colours of bodies in turn, on white; distinct also for colour-blind readers in neighbouring places."""

# fmt: off
BODIES_DARK = (
    "#6fa8e8", "#f2a25f", "#5fc79d", "#ef7d98", "#b197ea", "#d9b552", "#5fcbdd", "#ec93c8", "#aac25b", "#c99478",
)
# fmt: on
"""The same colours on a dark page."""

LINES = ("-", (0, (5.0, 1.6)), (0, (1.6, 1.3)), (0, (6.0, 1.4, 1.4, 1.4)))
"""Dashes of curves in turn, which differ in grey too."""

FOUND, TARGET = "#2f6db3", "#c0392b"
"""Colours of what was found and of what was asked for."""

_PAIRS = {
    "ink": ("#22272e", "#e4e8ee"),
    "soft": ("#7b8490", "#8f99a6"),
    "paper": ("#ffffff", "#171b21"),
    "velocity": ("#15803d", "#4ade80"),
    "acceleration": ("#c01f6e", "#f472b6"),
    "weight": ("#6b7280", "#9ca3af"),
    "applied": ("#b45309", "#fbbf24"),
    "reaction": ("#b91c1c", "#f87171"),
    "failure": ("#b42318", "#ff8a80"),
    "page": ("#f3f5f7", "#0f1216"),
    "line": ("#dfe4ea", "#2b323b"),
    "accent": ("#2f6db3", "#6fa8e8"),
}
LIGHT, DARK = ({name: pair[k] for name, pair in _PAIRS.items()} for k in (0, 1))
"""Colours that belong to no body, on white and on a dark page."""


def mix(colour: str, paper: str, share: float) -> str:
    """Mix two colours ``"#rrggbb"``, `share` of the first."""
    a, b = (tuple(int(c[i : i + 2], 16) for i in (1, 3, 5)) for c in (colour, paper))
    return "#" + "".join(f"{round(share * x + (1 - share) * y):02x}" for x, y in zip(a, b, strict=True))


def colour_of(name: str, body: int, dark: bool = False) -> str:
    """Find the colour that a role's colour name means for a body (by index; `INK` for none), ``"#rrggbb"``.

    The name is ``"body"``, ``"tint"`` or a key of `LIGHT`.
    """
    base, bodies = (DARK, BODIES_DARK) if dark else (LIGHT, BODIES)
    if name not in ("body", "tint"):
        return base[name]
    own = base["soft"] if body == INK else bodies[body % len(bodies)]
    if body == INK and name == "body":
        own = base["ink"]
    return own if name == "body" else mix(own, base["paper"], 0.42 if dark else 0.34)


_GREEK = dict(
    alpha="α", beta="β", gamma="γ", delta="δ", epsilon="ε", eta="η", theta="θ", mu="μ", xi="ξ", rho="ρ",
    sigma="σ", tau="τ", phi="φ", chi="χ", psi="ψ", omega="ω", **{"lambda": "λ"},
)  # fmt: skip


def symbol(name: str) -> str:
    """Write a name as in a picture: Greek letters for their names, digits after them kept."""
    stem = name.rstrip("0123456789")
    return _GREEK.get(stem, stem) + name[len(stem) :]


def short(value: float, digits: int = 4) -> str:
    """Write a number in few digits, with a real minus; rounding is zero."""
    return f"{0.0 if abs(value) < 1e-12 else value:.{digits}g}".replace("-", "−")


def axis_name(what: str, unit: str = "") -> str:
    """Write the name of an axis: a quantity and its unit."""
    return f"{what} [{unit}]" if unit else what


def furnish(ax: "Axes", grid: Literal["both", "x", "y", ""] = "both") -> None:
    """Give axes of the plane the look of the house: letters, ticks, a faint grid, two spines.

    Grid lines are across which axis: ``"both"``, ``"x"``, ``"y"`` or none. Names of axes set later keep the look.
    """
    ax.tick_params(which="both", labelsize=NUMBERS, color=LIGHT["soft"], labelcolor=LIGHT["ink"], length=2.5, width=0.6)
    if grid:
        ax.grid(True, axis=grid, color=GRID, linewidth=0.6)
        ax.set_axisbelow(True)
    for side, spine in ax.spines.items():
        spine.set(visible=side in ("left", "bottom"), color=LIGHT["soft"], linewidth=0.6)
    for axis in (ax.xaxis, ax.yaxis):
        axis.label.set(fontsize=TEXT, color=LIGHT["ink"], parse_math=False)
        axis.offsetText.set(fontsize=NUMBERS, color=LIGHT["ink"])


def crown(ax: "Axes", heading: str = "", room: float | None = None) -> float:
    """Put heading and legend above axes, in one line where both fit, heading on top otherwise; their height, points.

    Labelled curves are in the legend. The room is the width that there is, inches; what the axes have in their figure
    if not given.
    """
    figure = ax.figure.canvas.figure
    if room is None:
        cell = ax.get_subplotspec()
        width = cell.get_position(figure).width if cell is not None else ax.get_position().width
        if cell is not None and figure.get_layout_engine() is not None:  # which leaves no margins but what is written
            width /= figure.subplotpars.right - figure.subplotpars.left
        room = figure.get_figwidth() * width - (0.75 if cell is not None else 0.0)
    room *= 72.0
    lines, names = ax.get_legend_handles_labels()
    used, rows = 0.0, 0
    if lines:
        widths = [wide(name, NUMBERS) + 2.4 * NUMBERS for name in names]
        columns = next((c for c in range(min(len(names), 4), 1, -1) if _legend_width(widths, c) <= room), 1)
        used, rows = _legend_width(widths, columns), -(-len(names) // columns)
        legend = ax.legend(
            lines, names, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, frameon=False,
            fontsize=NUMBERS, handlelength=1.8, handletextpad=0.6, borderaxespad=0.2, borderpad=0.3, columnspacing=1.2,
        )  # fmt: skip
        for text in legend.get_texts():
            text.set(parse_math=False, color=LIGHT["ink"])
    taken = 1.55 * NUMBERS * rows
    if heading:
        fits = rows <= 1 and max(wide(part, HEADING) for part in heading.split("\n")) + used + HEADING <= room
        pad = 5.0 if fits else 7.0 + taken
        parts = [line for part in heading.split("\n") for line in wrap(part, HEADING, room)]
        ax.set_title("\n".join(parts), loc="left", fontsize=HEADING, color=LIGHT["ink"], parse_math=False, pad=pad)
        taken = pad + 1.3 * HEADING * len(parts)
    return taken


def _legend_width(widths: Sequence[float], count: int) -> float:
    """Measure the width of a legend in columns, points."""
    tall, more = divmod(len(widths), count)  # as matplotlib fills them: the first ones take one more
    starts = [k * tall + min(k, more) for k in range(count + 1)]
    return sum(max(widths[a:b]) + 1.2 * NUMBERS for a, b in itertools.pairwise(starts))


def wide(text: str, size: float) -> float:
    """Measure the width of a text in letters of a size, points, as they are fitted to pixels."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    # letters that are fitted to pixels take 1.04 of their width
    return 1.04 * float(TextToPath().get_text_width_height_descent(text, FontProperties(size=size), False)[0])


def wrap(text: str, size: float, room: float) -> list[str]:
    """Break a text into lines of a width, points."""
    lines: list[str] = []
    for word in text.split(" "):
        longer = f"{lines[-1]} {word}" if lines else word
        if lines and wide(longer, size) <= room:
            lines[-1] = longer
        else:
            lines.append(word)
    return lines
