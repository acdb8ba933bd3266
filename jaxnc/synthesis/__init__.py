"""Design: exact synthesis, tolerances and calibration. Everything is loaded on first use."""

import importlib

_HOME = {
    "jaxnc.synthesis.allocation": ("Allocation", "allocate_tolerances", "reciprocal", "reciprocal_square"),
    "jaxnc.synthesis.burmester": ("BurmesterCurves", "BurmesterPairs", "Dyad", "Guidance"),
    "jaxnc.synthesis.calibration": ("Calibration", "calibrate"),
    "jaxnc.synthesis.cognates": ("cognates", "coupler_curve", "distinct", "same_curve", "slider_crank_cognate"),
    "jaxnc.synthesis.freudenstein": (
        "FunctionDesign",
        "FunctionDesigns",
        "chebyshev_points",
        "freudenstein",
        "function_four_bar",
    ),
    "jaxnc.synthesis.guided": ("GuidedFourBar",),
    "jaxnc.synthesis.linkage": ("FourBar",),
    "jaxnc.synthesis.robust": ("Robust", "robust"),
    "jaxnc.synthesis.slider_crank": ("SliderCrank", "slider_crank_function"),
    "jaxnc.synthesis.tolerance": ("Tolerance", "tolerance"),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}
__all__ = sorted(_WHERE)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str):
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'jaxnc.synthesis' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
