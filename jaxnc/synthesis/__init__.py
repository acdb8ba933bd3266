"""Design by gradient: what a mechanism should do, and the best designs found for it. Loaded on first use."""

from typing import TYPE_CHECKING

from jaxnc.exports import on_demand

if TYPE_CHECKING:
    from jaxnc.synthesis.conditions import Condition as Condition
    from jaxnc.synthesis.conditions import condition as condition
    from jaxnc.synthesis.conditions import crank_turns as crank_turns
    from jaxnc.synthesis.conditions import direction as direction
    from jaxnc.synthesis.conditions import equal as equal
    from jaxnc.synthesis.conditions import length as length
    from jaxnc.synthesis.conditions import local as local
    from jaxnc.synthesis.conditions import on_circuit as on_circuit
    from jaxnc.synthesis.conditions import size as size
    from jaxnc.synthesis.conditions import symmetric as symmetric
    from jaxnc.synthesis.conditions import transmission_angle as transmission_angle
    from jaxnc.synthesis.conditions import within as within
    from jaxnc.synthesis.descent import Descent as Descent
    from jaxnc.synthesis.descent import Lane as Lane
    from jaxnc.synthesis.descent import descend as descend
    from jaxnc.synthesis.design import Design as Design
    from jaxnc.synthesis.exact.burmester import BurmesterCurves as BurmesterCurves
    from jaxnc.synthesis.exact.burmester import BurmesterPairs as BurmesterPairs
    from jaxnc.synthesis.exact.burmester import Dyad as Dyad
    from jaxnc.synthesis.exact.burmester import Guidance as Guidance
    from jaxnc.synthesis.exact.cognates import coupler_curve as coupler_curve
    from jaxnc.synthesis.exact.cognates import distinct as distinct
    from jaxnc.synthesis.exact.cognates import roberts_cognates as roberts_cognates
    from jaxnc.synthesis.exact.cognates import same_curve as same_curve
    from jaxnc.synthesis.exact.cognates import slider_crank_cognate as slider_crank_cognate
    from jaxnc.synthesis.exact.freudenstein import FunctionDesign as FunctionDesign
    from jaxnc.synthesis.exact.freudenstein import FunctionDesigns as FunctionDesigns
    from jaxnc.synthesis.exact.freudenstein import chebyshev_points as chebyshev_points
    from jaxnc.synthesis.exact.freudenstein import function_four_bars as function_four_bars
    from jaxnc.synthesis.exact.freudenstein import precision_four_bars as precision_four_bars
    from jaxnc.synthesis.exact.linkage import FourBar as FourBar
    from jaxnc.synthesis.exact.linkage import GuidedFourBar as GuidedFourBar
    from jaxnc.synthesis.exact.linkage import SliderCrank as SliderCrank
    from jaxnc.synthesis.exact.linkage import slider_crank_function as slider_crank_function
    from jaxnc.synthesis.exact.precision_points import PathDesigns as PathDesigns
    from jaxnc.synthesis.exact.precision_points import path_four_bars as path_four_bars
    from jaxnc.synthesis.function import FunctionGeneration as FunctionGeneration
    from jaxnc.synthesis.objective import Loss as Loss
    from jaxnc.synthesis.objective import Objective as Objective
    from jaxnc.synthesis.path import MotionGeneration as MotionGeneration
    from jaxnc.synthesis.path import PathGeneration as PathGeneration
    from jaxnc.synthesis.problem import Evaluation as Evaluation
    from jaxnc.synthesis.problem import Problem as Problem
    from jaxnc.synthesis.result import Result as Result
    from jaxnc.synthesis.result import Steps as Steps
    from jaxnc.synthesis.result import load as load
    from jaxnc.synthesis.search.fronts import Front as Front
    from jaxnc.synthesis.search.fronts import pareto as pareto
    from jaxnc.synthesis.search.solve import solve as solve
    from jaxnc.synthesis.search.stock import Stock as Stock
    from jaxnc.synthesis.search.stock import integer as integer
    from jaxnc.synthesis.search.stock import stock as stock
    from jaxnc.synthesis.tolerance.allocation import Allocation as Allocation
    from jaxnc.synthesis.tolerance.allocation import Cost as Cost
    from jaxnc.synthesis.tolerance.allocation import allocate_tolerances as allocate_tolerances
    from jaxnc.synthesis.tolerance.allocation import reciprocal as reciprocal
    from jaxnc.synthesis.tolerance.allocation import reciprocal_square as reciprocal_square
    from jaxnc.synthesis.tolerance.calibration import Calibration as Calibration
    from jaxnc.synthesis.tolerance.calibration import calibrate as calibrate
    from jaxnc.synthesis.tolerance.robust import Robust as Robust
    from jaxnc.synthesis.tolerance.robust import robust as robust
    from jaxnc.synthesis.tolerance.spread import Spread as Spread
    from jaxnc.synthesis.tolerance.spread import Tolerance as Tolerance
    from jaxnc.synthesis.tracing.atlas import Atlas as Atlas
    from jaxnc.synthesis.tracing.atlas import atlas as atlas
    from jaxnc.synthesis.tracing.chains import Chain as Chain
    from jaxnc.synthesis.tracing.chains import dyadic_chains as dyadic_chains
    from jaxnc.synthesis.tracing.trace import TracedDesign as TracedDesign
    from jaxnc.synthesis.tracing.trace import TraceResult as TraceResult
    from jaxnc.synthesis.tracing.trace import trace as trace


__getattr__, __dir__ = on_demand(__name__)
