"""How a body with explicit dimensions is redrawn: the order in which its points are placed, checked with names."""

import numpy as np

from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record


def recipe(
    name: str, body: record.Body, index: dict[str, int], home: np.ndarray
) -> tuple[tuple, list[tuple[str, float]]]:
    """How to place a body's points (see `jaxnc.system.shape`), and the explicit dimensions used, named, in order."""
    what = f"body {name!r}"
    values: list[tuple[str, float]] = []
    lengths = {}
    for key, value in body.lengths.items():
        p, q = _ends(key, index, what)
        if frozenset((p, q)) in lengths:
            raise MechanismError(f"{what}: the length {key} is given twice")
        lengths[frozenset((p, q))] = len(values)
        values.append((key, value))

    placed = {0: np.zeros(2), 1: np.array([_length(lengths, values, 0, 1, home), 0.0])}
    base = (0, 1, lengths.pop(frozenset((0, 1)), None))
    axis = home[1] - home[0]
    size = np.linalg.norm(axis)
    if size == 0:
        names = list(index)
        raise MechanismError(
            f"{what}: points {names[0]!r} and {names[1]!r} are drawn at the same place, so they give no direction; "
            f"move one of them"
        )
    spatial = home.shape[1] == 3
    turn = np.eye(3) if spatial else np.array([[axis[0], axis[1]], [-axis[1], axis[0]]]) / size
    drawn = (home - home[0]) @ turn.T
    if spatial:
        placed = {0: np.zeros(3), 1: placed[1][0] * axis / size}
    steps: list[tuple] = []
    rest = {k: p for p, k in index.items() if k > 1}
    for p, place in body.local.items():
        k = index[p]
        if any(k in pair for pair in lengths):
            raise MechanismError(f"{what}: point {p!r} has both a local place and a length; give one of them")
        values += [(f"{p}.along", place[0]), (f"{p}.across", place[1])]
        steps.append((k, "local", len(values) - 2, len(values) - 1))
        placed[k] = np.array(place)
        del rest[k]
    while rest:
        ties = {
            k: [next(iter(pair - {k})) for pair in lengths if k in pair and (pair - {k}) <= set(placed)] for k in rest
        }
        k = max(rest, key=lambda k: (len(ties[k]), -k))
        to = sorted(ties[k])
        if len(to) > 2:
            names = list(index)
            raise MechanismError(
                f"{what}: the place of point {rest[k]!r} is fixed by more than two lengths, to "
                f"{', '.join(names[i] for i in to)}; give two"
            )
        numbers = [lengths.pop(frozenset((k, i))) for i in to]
        if len(to) == 0:
            steps.append((k, "drawn"))
            placed[k] = drawn[k]
        elif len(to) == 1:
            w = drawn[k] - drawn[to[0]]
            if np.linalg.norm(w) == 0:
                raise MechanismError(
                    f"{what}: length {values[numbers[0]][0]} is given, but its points are drawn together"
                )
            steps.append((k, "polar", to[0], numbers[0]))
            placed[k] = placed[to[0]] + values[numbers[0]][1] * w / np.linalg.norm(w)
        else:
            steps.append((k, "two", to[0], numbers[0], to[1], numbers[1]))
            placed[k] = _triangle(what, values, to, numbers, placed, drawn, k)
        del rest[k]
    if lengths:
        key = values[next(iter(lengths.values()))][0]
        raise MechanismError(f"{what}: length {key} is between points whose places are already given; remove it")
    return (base, tuple(steps)), values


def _ends(key: str, index: dict[str, int], what: str) -> tuple[int, int]:
    p, _, q = key.partition("-")
    if p not in index or q not in index or p == q:
        raise MechanismError(f"{what}: length {key!r} is not between two of its points {list(index)}; write 'B-C'")
    return index[p], index[q]


def _length(lengths: dict, values: list, i: int, j: int, home: np.ndarray) -> float:
    number = lengths.get(frozenset((i, j)))
    return float(np.linalg.norm(home[j] - home[i])) if number is None else values[number][1]


def _triangle(what, values, to, numbers, placed, drawn, k) -> np.ndarray:
    (i, j), (ra, rb) = to, (values[n][1] for n in numbers)
    d = placed[j] - placed[i]
    span = float(np.linalg.norm(d))
    if not abs(ra - rb) <= span * (1 + 1e-12) <= (ra + rb) * (1 + 2e-12):
        a, b = (values[n][0] for n in numbers)
        raise MechanismError(
            f"{what}: lengths {a} = {ra:g} and {b} = {rb:g} violate the triangle inequality, the third side is "
            f"{span:g}; it must lie between {abs(ra - rb):g} and {ra + rb:g}"
        )
    along = (span**2 + ra**2 - rb**2) / (2 * span**2)
    height = np.sqrt(max(ra**2 / span**2 - along**2, 0.0))
    u, w = drawn[j] - drawn[i], drawn[k] - drawn[i]
    if len(u) == 3:
        across = w - (w @ d) / span**2 * d
        if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(w):
            raise MechanismError(
                f"{what}: a point with two lengths is drawn on the line between the points they start from, so its "
                f"side is not known; draw it on one side"
            )
        return placed[i] + along * d + height * span * across / np.linalg.norm(across)
    if u[0] * w[1] - u[1] * w[0] < 0:
        height = -height
    return placed[i] + along * d + height * np.array([-d[1], d[0]])
