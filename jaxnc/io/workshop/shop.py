"""What a workshop says of the plates that a mechanism is to be made of."""

import math
from dataclasses import dataclass, fields

from jaxnc.errors import InputError

MILLIMETRES = {"m": 1e3, "dm": 1e2, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "in": 25.4, "ft": 304.8}
"""Of one unit of length, by its label."""

WALL = 0.25
"""What is left between two holes, and around them, at least: a part of the pin's diameter."""


@dataclass(frozen=True)
class Shop:
    """Sizes in a workshop, all in mm.

    Attributes:
        width: of links, which are rounded by half of it.
        pin: diameter of pins.
        thickness: of the plates.
        clearance: what stays between parts that pass each other in one layer, at least.
        play: what holes and slots are wider than pins.
        washer: thickness of the washers between layers.
        spacer: outer diameter of washers and spacers.
        unit: how long a unit of length of the mechanism is.
        layers: how many layers there may be above the ground plate; as many as there are parts if None.
    """

    width: float
    pin: float
    thickness: float
    clearance: float
    play: float
    washer: float
    spacer: float
    unit: float
    layers: int | None

    @classmethod
    def of(
        cls,
        length_unit: str,
        width: float,
        pin: float,
        thickness: float,
        clearance: float,
        play: float,
        washer: float,
        spacer: float | None,
        unit: float | None,
        layers: int | None,
    ) -> "Shop":
        """Check the sizes, and put in those that follow from others.

        Raises:
            InputError: a size that is none, or sizes that do not go together.
        """
        if unit is None and length_unit not in MILLIMETRES:
            raise InputError(
                f"to_parts(): how long is a {length_unit or 'unit of length'!r} in mm? Give unit=, or use one of "
                f"{', '.join(MILLIMETRES)} in Mechanism(length_unit=)"
            )
        unit = MILLIMETRES[length_unit] if unit is None else unit
        if layers is not None and (not isinstance(layers, int) or isinstance(layers, bool) or layers < 1):
            raise InputError(f"to_parts(): layers={layers!r}; give how many there may be, a whole number from 1")
        spacer = 2.0 * pin if spacer is None and _number(pin) else spacer
        found = cls(width, pin, thickness, clearance, play, washer, spacer, unit, layers)  # pyright: ignore[reportArgumentType]
        for item in fields(found)[:-1]:
            value, least = getattr(found, item.name), item.name in ("play", "washer", "clearance")
            if not _number(value) or value < 0 or (value == 0 and not least):
                raise InputError(f"to_parts(): {item.name}={value!r} must be a positive number, in mm")
        if found.width < found.hole + 2 * found.wall:
            raise InputError(
                f"to_parts(): width={width:g} leaves no wall around holes of {found.hole:g} mm; make links at least "
                f"{found.hole + 2 * found.wall:g} wide, or the pins thinner"
            )
        if not found.hole < found.spacer <= found.width:
            raise InputError(
                f"to_parts(): spacer={found.spacer:g}; washers are wider than holes ({found.hole:g}) and not "
                f"wider than links ({found.width:g})"
            )
        return found

    @property
    def hole(self) -> float:
        """Diameter of holes, and width of slots."""
        return self.pin + self.play

    @property
    def wall(self) -> float:
        """The least that is left beside a hole."""
        return WALL * self.pin

    @property
    def pitch(self) -> float:
        """From one layer to the next."""
        return self.thickness + self.washer


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
