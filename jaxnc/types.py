"""Names for the shapes that run through the package."""

import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeAlias

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

PyTree: TypeAlias = Any
"""What `jax.tree` takes apart into arrays: records, tuples, lists and dicts of them, or one array."""

AnyArray: TypeAlias = Any
"""An array of NumPy or of JAX where code is the same for both, and type checkers cannot say; or None, or some."""

Coordinates: TypeAlias = Float[Array, " N"]
"""All coordinates of a mechanism in one pose: points, unit vectors, then angles and distances."""

Inputs: TypeAlias = Mapping[str, ArrayLike]
"""Driven coordinates by name, each a number or an array of values."""


class Scalar(Protocol):
    """A number in any arithmetic: plain, of an array, lanes of them, or one that writes down what is done to it."""

    def __add__(self, other: Any, /) -> Any: ...
    def __radd__(self, other: Any, /) -> Any: ...
    def __sub__(self, other: Any, /) -> Any: ...
    def __rsub__(self, other: Any, /) -> Any: ...
    def __mul__(self, other: Any, /) -> Any: ...
    def __rmul__(self, other: Any, /) -> Any: ...
    def __truediv__(self, other: Any, /) -> Any: ...
    def __neg__(self) -> Any: ...


class Components(Protocol):
    """Components of one point or of several, or a few scalars: an array, or what is indexed as one."""

    def __len__(self) -> int: ...
    def __getitem__(self, at: Any, /) -> Any: ...
