"""Owners of rows, numbers and loads: an id of what kind of thing it is and which one, never its name.

Names are the user's, and a body, a joint and a coordinate may have the same one. They stand in `Names` beside the index
structures, and become text only where something is shown.
"""

from collections import Counter
from collections.abc import Container, Iterable, Sequence
from enum import Enum, IntEnum
from typing import TYPE_CHECKING, NamedTuple

from jaxnc.errors import InputError, MechanismError

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism


class Thing(IntEnum):
    """Kinds of things that can own something. Within one of them names are unique."""

    BODY = 0
    POINT = 1
    VECTOR = 2
    COORDINATE = 3
    JOINT = 4
    RELATION = 5
    CONSTRAINT = 6
    MASS = 7
    FORCE = 8
    FRICTION = 9

    @property
    def noun(self) -> str:
        """The word for it."""
        return self.name.lower()


class Owner(NamedTuple):
    """A thing of a description: the `number`-th of its kind, in the order of the description."""

    thing: Thing
    number: int


GROUND = -1
"""In place of a body's number: the ground."""

Names = tuple[tuple[str, ...], ...]
"""By `Thing`, the names of all of them."""


def names_of(mechanism: "Mechanism") -> Names:
    """The names of everything in a description that can own something."""
    m, spots = mechanism.model, (mechanism.all_points, mechanism.all_vectors, mechanism.scalar_names)
    things = (m.bodies, *spots, m.joints, m.relations, m.constraints, m.masses, m.forces, m.friction)
    return tuple(map(tuple, things))


def called(names: Names, *owners: Owner) -> str:
    """Name a thing that some owners share."""
    return " and ".join(names[o.thing][o.number] for o in owners)


def find(names: Names, name: str, things: Iterable[Thing], among: Container[Owner] | None = None) -> Owner | None:
    """Find the thing that a name means, alone or with its kind in front, ``"joint B"``.

    Args:
        names: names of all things.
        name: the name.
        things: kinds that are looked through.
        among: the only ones that count; all if not given.

    Returns:
        The thing; None if there is none of this name.

    Raises:
        InputError: two things have the name.
    """
    things = tuple(things)
    named = [Owner(thing, names[thing].index(name)) for thing in things if name in names[thing]]
    found = [owner for owner in named if among is None or owner in among]
    if len(found) > 1:
        nouns = [owner.thing.noun for owner in found]
        raise InputError(
            f"{name!r} is the name of {' and '.join(f'a {noun}' for noun in nouns)}; say which, "
            f"{' or '.join(repr(f'{noun} {name}') for noun in nouns)}"
        )
    if found:
        return found[0]
    noun, _, rest = name.partition(" ")
    for thing in things:
        if noun == thing.noun and rest in names[thing]:
            owner = Owner(thing, names[thing].index(rest))
            return owner if among is None or owner in among else None
    return None


class Quantity(Enum):
    """The sort of number that an explicit dimension is."""

    LENGTH = "length"
    """Positive."""
    PLACE = "place"
    """A length with a sign: a coordinate in a body's frame, the advance of a screw."""
    FACTOR = "factor"
    """A pure number of either sign."""
    NUMBER = "number"
    """Whatever the user's equation makes of it."""

    @property
    def long(self) -> bool:
        """Tell whether the number grows with the drawing."""
        return self in (Quantity.LENGTH, Quantity.PLACE)


class Dimension(NamedTuple):
    """An explicit dimension: what it belongs to, its key there (``"A-B"``, ``"radius1"``, a coordinate), what it is."""

    owner: Owner
    key: str
    quantity: Quantity


def addresses(names: Names, entries: Sequence[tuple[Owner | None, str]]) -> list[str]:
    """By what a user calls numbers: ``name.key``; where two would have one address, the thing's kind stands before it.

    Args:
        names: names of all things.
        entries: for each number what it belongs to, and its key there; for what has a name of its own, None and that.
    """
    plain = [".".join(filter(None, ("" if owner is None else called(names, owner), key))) for owner, key in entries]
    shared = {name for name, count in Counter(plain).items() if count > 1}
    out = [
        f"{owner.thing.noun} {name}" if owner is not None and name in shared else name
        for (owner, _), name in zip(entries, plain, strict=True)
    ]
    for name, count in Counter(out).items():
        if count > 1:
            first, second, *_ = (entries[k] for k, other in enumerate(out) if other == name)
            said = [f"{what!r}" if o is None else f"{what!r} of {o.thing.noun} {called(names, o)!r}"
                    for o, what in (first, second)]  # fmt: skip
            raise MechanismError(f"{said[0]} and {said[1]} would both be addressed as {name!r}; rename one of them")
    return out
