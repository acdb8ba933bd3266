"""What a workshop says of the plates that a mechanism is to be made of."""

import math
from dataclasses import dataclass, fields
from numbers import Integral, Real
from typing import Any

from jaxnc.calls import public
from jaxnc.errors import InputError

MILLIMETRES = {"m": 1e3, "dm": 1e2, "cm": 10.0, "mm": 1.0, "um": 1e-3, "µm": 1e-3, "in": 25.4, "ft": 304.8}
"""Of one unit of length, by its label."""

_MAY_BE_ZERO = ("clearance", "play", "washer")


@public
@dataclass(frozen=True, kw_only=True)
class Shop:
    """Sizes in a workshop, all in mm.

    Attributes:
        width: of links, which are rounded by half of it.
        pin: diameter of pins.
        thickness: of all plates.
        clearance: what stays between parts that pass each other in one layer, at least.
        play: what holes and slots are wider than pins.
        washer: thickness of the washers between layers; may be 0.
        spacer: outer diameter of washers and spacers; twice the pin's if not given to `of`.
        unit: how long a unit of length of the mechanism is, 1000 for metres; by its label if not given to `of`.
        layers: how many layers there may be above the ground plate; as many as there are parts if None.
        density: of the plates, kg/m³: 7850 for steel, 2700 for aluminium, 1190 for acrylic glass; None if no masses are
            asked for.
    """

    width: float
    pin: float
    thickness: float
    clearance: float = 1.0
    play: float = 0.1
    washer: float = 0.5
    spacer: float
    unit: float
    layers: int | None = None
    density: float | None = None

    @classmethod
    def of(cls, length_unit: str, **sizes: Any) -> "Shop":
        """Check the sizes, and put in those that follow from others.

        Args:
            length_unit: label of the mechanism's unit of length.
            **sizes: the attributes above by name: `width`, `pin`, `thickness`, and any others.

        Raises:
            InputError: a size that is none, or sizes that do not go together.
        """
        if sizes.get("unit") is None:
            if length_unit not in MILLIMETRES:
                raise InputError(
                    f"to_parts(): how long is a {length_unit or 'unit of length'!r} in mm? Give unit=, or use one of "
                    f"{', '.join(MILLIMETRES)} in Mechanism(length_unit=)"
                )
            sizes["unit"] = MILLIMETRES[length_unit]
        if sizes.get("spacer") is None:
            sizes["spacer"] = 2.0 * sizes["pin"] if _is_finite(sizes["pin"]) else sizes["pin"]
        found = cls(**sizes)
        layers, density = found.layers, found.density
        if layers is not None and (not isinstance(layers, Integral) or isinstance(layers, bool) or layers < 1):
            raise InputError(f"to_parts(): layers={layers!r}; give how many there may be, a whole number from 1")
        for item in fields(found)[:-2]:
            value, may_be_zero = getattr(found, item.name), item.name in _MAY_BE_ZERO
            if not _is_finite(value) or value < 0 or (value == 0 and not may_be_zero):
                what = "a number, 0 or more" if may_be_zero else "a positive number"
                raise InputError(f"to_parts(): {item.name}={value!r} must be {what}, in mm")
        # 20 kg/m³ is foam; what is less was meant in g/cm³
        if density is not None and not (_is_finite(density) and density >= 20.0):
            raise InputError(f"to_parts(): density={density!r}; give it in kg/m³: 7850 for steel, 2700 for aluminium")
        least = found.hole + 2 * found.wall
        if found.width < least:
            raise InputError(
                f"to_parts(): width={found.width:g} leaves no wall around holes of {found.hole:g} mm; make links at "
                f"least {least:g} wide, or the pins thinner"
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
        return 0.25 * self.pin  # 0.25 of the pin's diameter is left between two holes, and around them, at least

    @property
    def pitch(self) -> float:
        """From one layer to the next."""
        return self.thickness + self.washer


SIZES = tuple(item.name for item in fields(Shop))
"""Names of what may be given of a workshop."""


def _is_finite(value: object) -> bool:
    return isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value)
