"""What one instance takes from the mechanism, numbered from zero as it is asked for."""

from jaxnc.families.bodies import Part
from jaxnc.families.program import Frame, Linear
from jaxnc.families.shapes import Recipe


class Scribe:
    """Collects the points, vectors, variables and readings of one instance."""

    def __init__(self):
        self.points: list[tuple[int, int]] = []  # pairs (point, where it is read)
        self.vectors: list[int] = []  # unit vectors
        self.scalars: list[str] = []  # names of variables
        self.recipes: list[Recipe] = []  # readings of constants
        self.frames: dict[int, Frame] = {}  # frames of parts that are made

    def p(self, point: int, part: Part | None = None) -> int:
        """A point as drawn, or of the (redrawn) shape of a part."""
        return _place(self.points, (point, part.drawn.get(point, point) if part else point))

    def at(self, points: tuple[int, ...], part: Part | None = None) -> tuple[int, ...]:
        """Several points."""
        return tuple(self.p(p, part) for p in points)

    def v(self, vector: int) -> int:
        """A unit vector."""
        return _place(self.vectors, vector)

    def s(self, name: str, factor: float = 1.0) -> Linear:
        """A variable."""
        return ((factor, "s", _place(self.scalars, name)),)

    def c(self, how: str, points: tuple[int, ...], vectors: tuple[int, ...] = (), extra: tuple = ()) -> list[Linear]:
        """Constants read off the drawing."""
        recipe = Recipe(how, points, vectors, extra)
        before = sum(r.count for r in self.recipes[: _place(self.recipes, recipe)])
        return [((1.0, "c", before + k),) for k in range(recipe.count)]


def _place(found: list, item) -> int:
    if item not in found:
        found.append(item)
    return found.index(item)


def fixed(value: float) -> Linear:
    """A number."""
    return ((value, "1", 0),) if value else ()
