"""What a row, a number or a load belongs to: an id of what kind of thing it is and which one, never its name.

Names are the user's, and a body, a joint and a coordinate may have the same one. They stand in `Names` beside the index
structures, and become text only where something is shown.
"""

from collections.abc import Iterable
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from jaxnc.mechanism import Mechanism


class Thing(IntEnum):
    """What can own something. Within one of them names are unique."""

    BODY = 0
    POINT = 1
    VECTOR = 2
    COORDINATE = 3
    JOINT = 4
    RELATION = 5
    CONSTRAINT = 6

    @property
    def noun(self) -> str:
        """The word for it."""
        return self.name.lower()


class Owner(NamedTuple):
    """One thing of a description: the `number`-th of its kind, in the order of the description."""

    thing: Thing
    number: int


GROUND = -1
"""In place of a body's number: the ground."""

Names = tuple[tuple[str, ...], ...]
"""By `Thing`, the names of all of them."""


def names_of(mechanism: "Mechanism") -> Names:
    """The names of everything in a description that can own something."""
    m = mechanism.model
    return (
        tuple(m.bodies),
        mechanism.all_points,
        mechanism.all_vectors,
        mechanism.scalar_names,
        tuple(m.joints),
        tuple(m.relations),
        tuple(m.constraints),
    )


def called(names: Names, *owners: Owner) -> str:
    """What is shared by some owners, as text."""
    return " and ".join(names[o.thing][o.number] for o in owners)


def find(names: Names, name: str, things: Iterable[Thing]) -> Owner | None:
    """The thing of a name: of the first of some kinds that has one, or of the kind before the name, ``"joint B"``."""
    things = tuple(things)
    for thing in things:
        if name in names[thing]:
            return Owner(thing, names[thing].index(name))
    noun, _, rest = name.partition(" ")
    for thing in things:
        if noun == thing.noun and rest in names[thing]:
            return Owner(thing, names[thing].index(rest))
    return None
