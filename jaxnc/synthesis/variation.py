"""Dimensions as they come out of the workshop: which vary, how far, and samples of them."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np

from jaxnc.asking import numbers
from jaxnc.errors import InputError
from jaxnc.kinematics.inputs import positive
from jaxnc.kinematics.sensitivity import design_components
from jaxnc.system.system import System
from jaxnc.types import Array, ArrayLike, Float

DISTRIBUTIONS = ("normal", "uniform")


@dataclasses.dataclass(frozen=True)
class Variation:
    """Random deviations of design variables from their nominal values."""

    names: tuple[str, ...]  # components of design variables, "B.x", "crank.A-B"
    at: np.ndarray  # their places in the flat parameters, (k,)
    units: tuple[str, ...]  # length unit or "rad"
    tolerances: np.ndarray  # half widths t of the ranges nominal ± t, (k,)
    covariance: np.ndarray  # of the deviations, (k, k)
    distribution: str  # "normal" or "uniform"
    sigmas: float  # how many standard deviations a tolerance is, for the normal distribution

    @property
    def correlated(self) -> bool:
        """Whether the deviations depend on one another."""
        return bool(np.any(self.covariance != np.diag(np.diag(self.covariance))))

    def draw(self, key: Array, samples: int) -> Float[Array, "samples k"]:
        """Samples of the deviations."""
        if self.distribution == "uniform":
            return jax.random.uniform(key, (samples, len(self.at)), minval=-1.0) * self.tolerances
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return jax.random.normal(key, (samples, len(self.at))) @ root.T


def variation(
    what: str,
    system: System,
    tolerances: Mapping[str, ArrayLike],
    distribution: str = "normal",
    covariance: ArrayLike | None = None,
    sigmas: float = 3.0,
) -> Variation:
    """Read what a user says about the deviations of dimensions.

    A tolerance is the half width of a range, `sigmas` standard deviations, by design variable (then of each of its
    components) or component. The distribution is ``"normal"`` or ``"uniform"``; the covariance is ``(k, k)``,
    independent if not given.
    """
    if distribution not in DISTRIBUTIONS:
        raise InputError(f"{what}: distribution={distribution!r}; use {' or '.join(map(repr, DISTRIBUTIONS))}")
    positive(sigmas, f"{what}: sigmas (3 means that ± the tolerance is ± 3 σ)")
    sigmas = float(sigmas)
    if not isinstance(tolerances, Mapping) or not tolerances:
        raise InputError(f"{what}: no tolerances; give tolerances={{'crank.A-B': 0.01, …}} by design variable")
    names: list[str] = []
    at: list[int] = []
    units: list[str] = []
    widths: list[float] = []
    for name, value in tolerances.items():
        parts, places, labels = components(what, system, name)
        width = _width(what, name, value, len(parts))
        for part, place, label, w in zip(parts, places, labels, width, strict=True):
            if part in names:
                raise InputError(f"{what}: {part!r} has two tolerances; give it one")
            names.append(part)
            at.append(int(place))
            units.append(label)
            widths.append(float(w))
    half = np.array(widths)
    spread = half / sigmas if distribution == "normal" else half / math.sqrt(3.0)
    matrix = np.diag(spread**2)
    if covariance is not None:
        matrix = _covariance(what, covariance, names, distribution)
        half = sigmas * np.sqrt(np.diag(matrix))
    return Variation(tuple(names), np.array(at), tuple(units), half, matrix, distribution, float(sigmas))


def components(what: str, system: System, name: str) -> tuple[tuple[str, ...], np.ndarray, tuple[str, ...]]:
    """Components of a design variable, or one component: names, places, units."""
    try:
        return design_components(system, [name])
    except InputError as error:
        raise InputError(str(error).replace("sensitivity:", f"{what}:")) from None


def _width(what: str, name: str, value: Any, count: int) -> np.ndarray:
    try:
        width = np.asarray(value, float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what}: tolerance of {name!r} must be a number, got {value!r}") from None
    if width.shape not in ((), (count,)):
        raise InputError(f"{what}: tolerance of {name!r} has shape {width.shape}; give a number or one for each of "
                         f"its {count} components")  # fmt: skip
    if not (np.isfinite(width).all() and (width >= 0).all()):
        raise InputError(f"{what}: tolerance of {name!r} must be finite and not negative, got {value!r}")
    return np.broadcast_to(width, (count,))


def _covariance(what: str, covariance: ArrayLike, names: list[str], distribution: str) -> np.ndarray:
    if distribution != "normal":
        raise InputError(f"{what}: covariance= is for distribution='normal'; leave it out for {distribution!r}")
    matrix = numbers(covariance, f"{what}: covariance")
    if matrix.shape != (len(names), len(names)):
        raise InputError(
            f"{what}: covariance has shape {matrix.shape}; the {len(names)} components {', '.join(names)} need "
            f"({len(names)}, {len(names)})"
        )
    size = float(np.abs(matrix).max(initial=0.0))
    if not np.isfinite(matrix).all() or np.abs(matrix - matrix.T).max() > 1e-12 * size:
        raise InputError(f"{what}: covariance must be finite and symmetric")
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < -1e-12 * size:
        raise InputError(f"{what}: covariance has the negative eigenvalue {least:.3g}; no deviations vary like that")
    return matrix
