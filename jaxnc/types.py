"""Names for the shapes that run through the package."""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import numpy as np

if TYPE_CHECKING or "jaxtyping" in sys.modules:  # whoever checks shapes has imported it; by itself it would take 20 ms
    from jaxtyping import Array, ArrayLike, Float, Int
else:
    from jax import Array
    from jax.typing import ArrayLike

    class _Shaped:
        def __class_getitem__(cls, item: tuple[Any, str]) -> Any:
            return Annotated[item]

    class Float(_Shaped):
        """Of floats: ``Float[Array, "points dim"]``."""

    class Int(_Shaped):
        """Of integers."""


Numbers: TypeAlias = Array | np.ndarray
"""An array of JAX's, or of NumPy's where the host has found it and nothing is traced."""

Coordinates: TypeAlias = Float[Array, " N"]
"""All coordinates of a mechanism in one pose: points, unit vectors, then angles and distances."""

Inputs: TypeAlias = Mapping[str, ArrayLike]
"""Driven coordinates by name, each a number or an array of values."""

__all__ = ["Any", "Array", "ArrayLike", "Coordinates", "Float", "Inputs", "Int", "Numbers"]
