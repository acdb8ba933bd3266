"""How a body with explicit dimensions is redrawn: the order in which its points are placed, checked with names."""

import numpy as np

from jaxnc.errors import MechanismError
from jaxnc.mechanism import model as record
from jaxnc.system.design import recipe_formula


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

    base = (0, 1, lengths.pop(frozenset((0, 1)), None))
    if not np.linalg.norm(home[1] - home[0]):
        names = list(index)
        raise MechanismError(
            f"{what}: points {names[0]!r} and {names[1]!r} are drawn at the same place, so they give no direction; "
            f"move one of them"
        )
    steps: list[tuple] = []
    rest, placed = {k: p for p, k in index.items() if k > 1}, {0, 1}
    for p, place in body.local.items():
        k = index[p]
        if any(k in pair for pair in lengths):
            raise MechanismError(f"{what}: point {p!r} has both a local place and a length; give one of them")
        values += [(f"{p}.along", place[0]), (f"{p}.across", place[1])]
        steps.append((k, "local", len(values) - 2, len(values) - 1))
        placed.add(k)
        del rest[k]
    while rest:
        ties = {k: [next(iter(pair - {k})) for pair in lengths if k in pair and (pair - {k}) <= placed] for k in rest}
        k = max(rest, key=lambda k: (len(ties[k]), -k))
        to = sorted(ties[k])
        if len(to) > 2:
            names = list(index)
            raise MechanismError(
                f"{what}: the place of point {rest[k]!r} is fixed by more than two lengths, to "
                f"{', '.join(names[i] for i in to)}; give two"
            )
        numbers = [lengths.pop(frozenset((k, i))) for i in to]
        if len(to) == 1 and not np.linalg.norm(home[k] - home[to[0]]):
            raise MechanismError(f"{what}: length {values[numbers[0]][0]} is given, but its points are drawn together")
        how = ("drawn", "polar", "two")[len(to)]
        steps.append((k, how, *(x for pair in zip(to, numbers, strict=True) for x in pair)))
        placed.add(k)
        del rest[k]
    if lengths:
        key = values[next(iter(lengths.values()))][0]
        raise MechanismError(f"{what}: length {key} is between points whose places are already given; remove it")
    _check_triangles(what, (base, tuple(steps)), values, home)
    return (base, tuple(steps)), values


def _ends(key: str, index: dict[str, int], what: str) -> tuple[int, int]:
    p, _, q = key.partition("-")
    if p not in index or q not in index or p == q:
        raise MechanismError(f"{what}: length {key!r} is not between two of its points {list(index)}; write 'B-C'")
    return index[p], index[q]


def _check_triangles(what: str, steps: tuple, values: list[tuple[str, float]], home: np.ndarray) -> None:
    """Refuse lengths with which a body cannot be redrawn, and points whose side is not drawn."""
    if not any(how == "two" for _, how, *_ in steps[1]):
        return
    sizes = [value for _, value in values]
    with np.errstate(all="ignore"):
        at = recipe_formula(steps, *home.shape, len(sizes)).on_lanes([*home.reshape(-1), *map(np.float64, sizes)])
    placed = np.array(at, float).reshape(home.shape)
    for k, how, *data in steps[1]:
        if how != "two":
            continue
        i, a, j, b = data
        d, (ra, rb) = placed[j] - placed[i], (sizes[a], sizes[b])
        span = float(np.linalg.norm(d))
        if not abs(ra - rb) <= span * (1 + 1e-12) <= (ra + rb) * (1 + 2e-12):
            raise MechanismError(
                f"{what}: lengths {values[a][0]} = {ra:g} and {values[b][0]} = {rb:g} violate the triangle inequality, "
                f"the third side is {span:g}; it must lie between {abs(ra - rb):g} and {ra + rb:g}"
            )
        w = home[k] - home[i]
        if len(w) == 3 and np.linalg.norm(w - (w @ d) / span**2 * d) <= 1e-9 * np.linalg.norm(w):
            raise MechanismError(
                f"{what}: a point with two lengths is drawn on the line between the points they start from, so its "
                f"side is not known; draw it on one side"
            )
