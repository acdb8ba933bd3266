"""Kinds of rows that are the families' own, besides those of the catalogue written over places."""

from jaxnc.constraints.kind import Kind, dot
from jaxnc.pickling import factory, register_by_name

PAIR = Kind(
    "parallel in two rows",
    lambda p, v, s, c: (
        v[0][0] * v[1][0] + v[0][1] * v[1][1] + v[0][2] * v[1][2],
        v[0][0] * v[2][0] + v[0][1] * v[2][1] + v[0][2] * v[2][2],
    ),
    rows=("across 1", "across 2"),
    powers=(0, 0),
    vectors=3,
    source="§4.2.2: a direction of one body stays across two directions of the other",
)


SAME_TURN = Kind(
    "same orientation",
    lambda p, v, s, c: (dot(v[1], v[5]), dot(v[2], v[3]), dot(v[0], v[4])),
    rows=("about x", "about y", "about z"),
    powers=(0, 0, 0),
    vectors=6,
    # Half turns and the cyclic third of a turn meet the rows too; their matrices have a trace below one.
    guard=lambda p, v, s, c: (dot(v[0], v[3]) + dot(v[1], v[4]) + dot(v[2], v[5]) - 1.0,),
    source="the paper: a loop that is closed by six equations, three of them about its orientation",
)


@factory
def _held(axis: int) -> Kind:
    return Kind(
        f"held {'xyz'[axis]}",
        lambda p, v, s, c: (p[0][axis] - p[1][axis],),
        rows=("xyz"[axis],),
        points=2,
        source="a coordinate of a point that does not change",
    )


@factory
def _coordinate(axis: int, vector: bool) -> Kind:
    return Kind(
        f"coordinate {'xyz'[axis]}",
        lambda p, v, s, c: (),
        rows=(),
        powers=(),
        points=int(not vector),
        vectors=int(vector),
        measure=lambda p, v, c: (v if vector else p)[0][axis],
    )


@factory
def _at(axis: int) -> Kind:
    return Kind(
        f"at {'xyz'[axis]}",
        lambda p, v, s, c: (p[0][axis] - s[0],),
        rows=("xyz"[axis],),
        points=1,
        scalars=1,
        source="a coordinate of a point as a variable",
    )


AT = tuple(map(_at, range(3)))
HELD = tuple(map(_held, range(3)))
COORDINATE = {vector: tuple(_coordinate(axis, vector) for axis in range(3)) for vector in (False, True)}
register_by_name(__name__, (PAIR, SAME_TURN))
