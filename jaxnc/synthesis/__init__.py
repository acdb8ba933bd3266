"""Design by gradient: what a mechanism should do, and the best designs found for it. Loaded on first use."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.synthesis.allocation import Allocation, Cost, allocate_tolerances, reciprocal, reciprocal_square
    from jaxnc.synthesis.burmester import BurmesterCurves, BurmesterPairs, Dyad, Guidance
    from jaxnc.synthesis.calibration import Calibration, calibrate
    from jaxnc.synthesis.cognates import coupler_curve, distinct, roberts_cognates, same_curve, slider_crank_cognate
    from jaxnc.synthesis.conditions import (
        Condition,
        condition,
        crank_turns,
        equal,
        length,
        local,
        size,
        symmetric,
        transmission_angle,
        within,
    )
    from jaxnc.synthesis.descending import descend
    from jaxnc.synthesis.descent import Descent, Lane
    from jaxnc.synthesis.freudenstein import (
        FunctionDesign,
        FunctionDesigns,
        chebyshev_points,
        function_four_bars,
        precision_four_bars,
    )
    from jaxnc.synthesis.fronts import Front, pareto
    from jaxnc.synthesis.function import FunctionGeneration
    from jaxnc.synthesis.guidance import MotionGeneration
    from jaxnc.synthesis.guided import GuidedFourBar
    from jaxnc.synthesis.linkage import FourBar
    from jaxnc.synthesis.loss import Loss
    from jaxnc.synthesis.objective import Objective
    from jaxnc.synthesis.path import PathGeneration
    from jaxnc.synthesis.path_points import PathDesigns, path_four_bars
    from jaxnc.synthesis.postures import direction, on_circuit
    from jaxnc.synthesis.problem import Evaluation, Problem
    from jaxnc.synthesis.result import Design, Result, load
    from jaxnc.synthesis.robustness import Robust, robust
    from jaxnc.synthesis.search import solve
    from jaxnc.synthesis.sizes import Stock, integer, stock
    from jaxnc.synthesis.slider_crank import SliderCrank, slider_crank_function
    from jaxnc.synthesis.steps import Steps
    from jaxnc.synthesis.tolerance import Spread, Tolerance

__all__ = [
    "Allocation",
    "BurmesterCurves",
    "BurmesterPairs",
    "Calibration",
    "Condition",
    "Cost",
    "Descent",
    "Design",
    "Dyad",
    "Evaluation",
    "FourBar",
    "Front",
    "FunctionDesign",
    "FunctionDesigns",
    "FunctionGeneration",
    "Guidance",
    "GuidedFourBar",
    "Lane",
    "Loss",
    "MotionGeneration",
    "Objective",
    "PathDesigns",
    "PathGeneration",
    "Problem",
    "Result",
    "Robust",
    "SliderCrank",
    "Spread",
    "Steps",
    "Stock",
    "Tolerance",
    "allocate_tolerances",
    "calibrate",
    "chebyshev_points",
    "condition",
    "coupler_curve",
    "crank_turns",
    "descend",
    "direction",
    "distinct",
    "equal",
    "function_four_bars",
    "integer",
    "length",
    "load",
    "local",
    "on_circuit",
    "pareto",
    "path_four_bars",
    "precision_four_bars",
    "reciprocal",
    "reciprocal_square",
    "roberts_cognates",
    "robust",
    "same_curve",
    "size",
    "slider_crank_cognate",
    "slider_crank_function",
    "solve",
    "stock",
    "symmetric",
    "transmission_angle",
    "within",
]

__getattr__, __dir__ = on_demand(__name__)
