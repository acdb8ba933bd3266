"""Bodies with explicit dimensions, redrawn: local coordinates of their points as a function of drawing and dimensions.

A recipe is a static tuple ``(base, steps)``. ``base = (i, j, d)``: the body's x axis runs from its point i to its point
j, at the drawn distance (d is None) or at dimension number d. Each step places one more point k:

``(k, "drawn")``            where it is drawn relative to point i and the axis;
``(k, "local", d, e)``      at the local coordinates given as dimensions d and e;
``(k, "polar", i, d)``      in the drawn direction from point i, at distance d;
``(k, "two", i, d, j, e)``  at distances d and e from points i and j, on the drawn side.

Constants of constraints are then read off the redrawn body exactly as they are read off the drawing.
"""

from jaxnc.constraints.elementary import ratio, root, stacked, where
from jaxnc.constraints.kind import cross, dot, norm
from jaxnc.types import Array, Float


def redraw(recipe: tuple, home: Float[Array, "k dim"], values: Float[Array, " d"]) -> Float[Array, "k dim"]:
    """Place a body's points by a recipe: in the plane in its own frame, in space around its first point as drawn."""
    return (_in_plane if home.shape[1] == 2 else _in_space)(recipe, home, values)


def _in_space(recipe: tuple, home: Float[Array, "k 3"], values: Float[Array, " d"]) -> Float[Array, "k 3"]:
    (i, j, given), steps = recipe
    axis = home[j] - home[i]
    stretch = 1.0 if given is None else values[given] * ratio(1.0, norm(axis))
    placed: dict[int, Array] = {i: home[i], j: home[i] + stretch * axis}
    for k, how, *data in steps:
        if how == "drawn":
            placed[k] = home[k]
        elif how == "polar":
            origin, d = data
            w = home[k] - home[origin]
            placed[k] = placed[origin] + values[d] * ratio(1.0, norm(w)) * w
        else:
            a, d, b, f = data
            placed[k] = _two_spheres(placed[a], values[d], placed[b], values[f], home[k] - home[a])
    return stacked([placed[k] for k in range(home.shape[0])])


def _two_spheres(a, ra, b, rb, drawn):
    """The point at two distances that lies on the drawn side of the line of centres."""
    d = b - a
    span = dot(d, d)
    along = ratio(span + ra * ra - rb * rb, 2.0 * span)
    square = ra * ra - along * along * span
    height = root(square)
    across = drawn - ratio(dot(drawn, d), span) * d
    return a + along * d + height * ratio(1.0, norm(across)) * across


def _in_plane(recipe: tuple, home: Float[Array, "k 2"], values: Float[Array, " d"]) -> Float[Array, "k 2"]:
    """Place a body's points in its own frame by a recipe, the base segment along x from the origin."""
    (i, j, given), steps = recipe
    axis = home[j] - home[i]
    length = norm(axis)
    e = stacked([ratio(axis[0], length), ratio(axis[1], length)])
    drawn = [stacked([dot(e, w), cross(e, w)]) for w in (home[k] - home[i] for k in range(home.shape[0]))]
    placed: dict[int, Array] = {
        i: 0.0 * axis,
        j: stacked([length if given is None else values[given], 0.0]),
    }
    for k, how, *data in steps:
        if how == "drawn":
            placed[k] = drawn[k]
        elif how == "local":
            placed[k] = stacked([values[data[0]], values[data[1]]])
        elif how == "polar":
            origin, d = data
            w = drawn[k] - drawn[origin]
            n = norm(w)
            placed[k] = placed[origin] + values[d] * stacked([ratio(w[0], n), ratio(w[1], n)])
        else:
            a, d, b, f = data
            placed[k] = _two_distances(
                placed[a], values[d], placed[b], values[f], cross(drawn[b] - drawn[a], drawn[k] - drawn[a])
            )
    return stacked([placed[k] for k in range(home.shape[0])])


def _two_distances(a, ra, b, rb, side):
    """Intersection of two circles on the drawn side; on the line of centres if they do not meet."""
    d = b - a
    span = dot(d, d)
    along = ratio(span + ra * ra - rb * rb, 2.0 * span)
    square = ratio(ra * ra, span) - along * along
    height = root(square)
    height = where(side < 0, -height, height)
    return a + along * d + height * stacked([-d[1], d[0]])
