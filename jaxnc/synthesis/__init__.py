"""Design: exact synthesis, tolerances and calibration. Everything is loaded on first use."""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jaxnc.synthesis.allocation import Allocation, allocate_tolerances, reciprocal, reciprocal_square
    from jaxnc.synthesis.burmester import BurmesterCurves, BurmesterPairs, Dyad, Guidance
    from jaxnc.synthesis.calibration import Calibration, calibrate
    from jaxnc.synthesis.cognates import coupler_curve, distinct, roberts_cognates, same_curve, slider_crank_cognate
    from jaxnc.synthesis.freudenstein import (
        FunctionDesign,
        FunctionDesigns,
        chebyshev_points,
        function_four_bars,
        precision_four_bars,
    )
    from jaxnc.synthesis.guided import GuidedFourBar
    from jaxnc.synthesis.linkage import FourBar
    from jaxnc.synthesis.robust import Robust
    from jaxnc.synthesis.slider_crank import SliderCrank, slider_crank_function
    from jaxnc.synthesis.tolerance import Tolerance

_HOME = {
    "jaxnc.synthesis.allocation": (
        "Allocation",
        "allocate_tolerances",
        "reciprocal",
        "reciprocal_square",
    ),
    "jaxnc.synthesis.burmester": (
        "BurmesterCurves",
        "BurmesterPairs",
        "Dyad",
        "Guidance",
    ),
    "jaxnc.synthesis.calibration": (
        "Calibration",
        "calibrate",
    ),
    "jaxnc.synthesis.cognates": (
        "coupler_curve",
        "distinct",
        "roberts_cognates",
        "same_curve",
        "slider_crank_cognate",
    ),
    "jaxnc.synthesis.freudenstein": (
        "FunctionDesign",
        "FunctionDesigns",
        "chebyshev_points",
        "function_four_bars",
        "precision_four_bars",
    ),
    "jaxnc.synthesis.guided": ("GuidedFourBar",),
    "jaxnc.synthesis.linkage": ("FourBar",),
    "jaxnc.synthesis.robust": ("Robust",),
    "jaxnc.synthesis.slider_crank": (
        "SliderCrank",
        "slider_crank_function",
    ),
    "jaxnc.synthesis.tolerance": ("Tolerance",),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "Allocation",
    "BurmesterCurves",
    "BurmesterPairs",
    "Calibration",
    "Dyad",
    "FourBar",
    "FunctionDesign",
    "FunctionDesigns",
    "Guidance",
    "GuidedFourBar",
    "Robust",
    "SliderCrank",
    "Tolerance",
    "allocate_tolerances",
    "calibrate",
    "chebyshev_points",
    "coupler_curve",
    "distinct",
    "function_four_bars",
    "precision_four_bars",
    "reciprocal",
    "reciprocal_square",
    "roberts_cognates",
    "same_curve",
    "slider_crank_cognate",
    "slider_crank_function",
]


def __getattr__(name: str):
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'jaxnc.synthesis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
