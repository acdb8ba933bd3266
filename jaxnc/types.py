"""Names for the shapes that run through the package."""

from collections.abc import Mapping
from typing import Any, TypeAlias

from jaxtyping import Array, ArrayLike, Float

Coordinates: TypeAlias = Float[Array, " N"]
"""All coordinates of a mechanism in one pose: points, unit vectors, then angles and distances."""

Inputs: TypeAlias = Mapping[str, ArrayLike]
"""Driven coordinates by name, each a number or an array of values."""

__all__ = ["Any", "Array", "ArrayLike", "Coordinates", "Float", "Inputs"]
