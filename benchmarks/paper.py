"""``python -m benchmarks.paper``: writes docs/paper.md, the short paper, with the numbers of the benchmarks.

The text is here, in the form that the Journal of Open Source Software asks for; every number in it stands for one of
the JSON files of this folder, or for a count of the package, and `tests/docs/test_paper.py` asks that the page is
current.
"""

import json
import re
import statistics
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
PAGE = HERE.parent / "docs" / "paper.md"

TEXT = """---
title: 'jaxnc: mechanisms that can be designed by gradient, in natural coordinates on JAX'
tags:
  - Python
  - JAX
  - mechanism synthesis
  - multibody dynamics
  - natural coordinates
  - automatic differentiation
authors:
  - name: The jaxnc authors
    affiliation: '@one@'
affiliations:
  - name: Independent
    index: @one@
bibliography: paper.bib
---

<!-- Written by `python -m benchmarks.paper`. Do not edit: change benchmarks/paper.py and run it again. -->

# Summary

A linkage is usually drawn before it is calculated: points, bars between them, joints where bars meet. `jaxnc` takes the
drawing as it is. A planar or spatial mechanism is described by its points, bodies, joints and forces, in *natural
coordinates* [@GarciaDeJalon1994]: the Cartesian coordinates of points and unit vectors, constrained by lengths, areas
and scalar products that are polynomials of low degree. The library assembles the drawing, moves it along one branch to
rounding, simulates it under forces, and searches for dimensions that make it do what is wanted. All of it can be
differentiated, to any order and by every point and length that was drawn, as a program of JAX [@jax2018].

A compiled mechanism is a pytree. `jax.jit`, `jax.vmap` and `jax.grad` go through it, and so do optimisers, root finders
and integrators of other libraries [@deepmind2020; @rader2024; @kidger2021]: design variables by name, closed constraint
equations for any solver of nonlinear systems, the motion as a vector field for any integrator. @mechanisms@ ready
mechanisms, from the four-bar to suspensions and platforms, come with the package.

# Statement of need

Three communities calculate mechanisms and share little software. Theory of mechanisms has exact synthesis and closed
forms, mostly written anew for each linkage. Multibody engines simulate anything, but give derivatives by the state, not
by the design, and their loops are closed by penalties or by constraint forces that drift. Differentiable physics
engines have gradients, for trees of joint angles whose closed loops are soft.

What lies between is the daily work of design: the same closed loop in a hundred thousand variants, each solved exactly
and on the right assembly, with the derivative of a path, a force or a cost by each of its dimensions. `jaxnc` is made
for that. Failure is data: a pose that does not exist has a status and a derivative of zero instead of an exception or
a NaN, so that a search may walk along the border of what assembles, and a change of branch is one of the statuses.

# State of the field

Times are processor time on one core of an @cpu@, for one pose of a four-bar in a batch, all with the same residual;
every lane of every run was compared with a closed form.

| | ns per pose |
|---|--:|
@table@

Value and gradient by all dimensions take @gradient@ times the value; a Hessian-vector product @hessian@ times. A
MacPherson suspension takes @macpherson@ µs a pose, @naive@ times less than the same equations under `jax.vmap` with a
Newton loop. A row of @row@ coordinates is solved by sparse elimination in @rowms@ ms a Newton step.

A four-bar that moves for ten seconds in engines of multibody dynamics, each at the cheapest of several settings that
keeps the energy to the same small part (@engine@):

| | error | s |
|---|--:|--:|
@engines@

Pinocchio [@carpentier2019], MuJoCo [@todorov2012] and Exudyn [@gerstmayr2024] do far more than close a loop, and none
of them is made for this one; the table says what the loop costs there. Differentiable engines such as Brax
[@freeman2021] state closed loops by forces. Packages of linkage synthesis, pylinkage [@pylinkage] among them, search
without gradients. Optimisation of large numbers of designs at once is what JAX brings: @designs@ ns for each pose of as
many four-bars as there are poses, where the ensemble of pylinkage takes @ensemble@ ns.

# Design by gradient

Published problems of path synthesis are met or bettered from random starts. The closed path through @points@ points of
Bulatović and others [-@bulatovic2016], who reached @known@, ends at an error of @error@ with all of @keys@ seeds, in a
median of @seconds@ s of processor time. Ten thousand four-bars at @poses@ poses each take @value@ s for all values,
@both@ s for values and gradients. \\autoref{fig:growth} shows how times grow with the size of a batch and of a
mechanism.

![Time with the size of a batch and of a mechanism.\\label{fig:growth}](../benchmarks/growth.png)

![Four ideas: natural coordinates.\\label{fig:natural}](concepts_natural.png)

# Tests

What is calculated is compared with formulations that share nothing with it: closed forms, chains of rotations,
independent equations solved in NumPy, and published numbers. Examples of every page of the documentation run in the
tests and print what is written there.

# Acknowledgements

The formulation is that of Javier García de Jalón and Eduardo Bayo.

# References
"""

WAYS = {
    "C, Newton in eight lanes, by hand": "C Newton, 8 lanes, n = 4",
    "`jaxnc`": "jaxnc",
    "NumPy, closed form": "NumPy closed form",
    "pylinkage, `step_fast`": "pylinkage step_fast",
    "numba, Newton": "numba Newton, n = 4",
    "JAX, `vmap` of a Newton loop": "naive JAX, n = 2",
    "optimistix, `root_find` under `vmap`": "optimistix Newton, n = 4",
    "SciPy, `fsolve` in a loop": "SciPy fsolve loop, n = 2",
}


def loaded(name: str) -> Any:
    return json.loads((HERE / name).read_text(encoding="utf-8"))


def numbers() -> dict[str, str]:
    """What stands for each mark of the text."""
    from jaxnc.library import CATALOGUE

    results, dynamics, synthesis = (loaded(f"{name}.json") for name in ("results", "dynamics", "synthesis"))
    times = {(row["case"], row["way"]): row["median_ns_per_lane"] for row in results["rows"]}
    ratios = {ratio["name"]: ratio["value"] for ratio in results["ratios"]}
    row = "row of four-bars, Newton step, 10,000 coordinates"
    runs = synthesis["cases"]["25 points"]
    values, both = synthesis["cases"]["gradients"]
    engines = [e for e in dynamics["engines"] if "inside jit" not in e["engine"]]
    return {
        "one": "1",
        "mechanisms": str(len(CATALOGUE)),
        "cpu": results["machine"]["cpu"],
        "table": "\n".join(f"| {said} | {times['four-bar', way]:,.0f} |" for said, way in WAYS.items()),
        "gradient": f"{ratios['value and gradient / value']:.1f}",
        "hessian": f"{ratios['Hessian-vector product / value']:.1f}",
        "macpherson": f"{times['macpherson', 'jaxnc'] / 1e3:.2f}",
        "naive": f"{ratios['macpherson: naive JAX / jaxnc']:.0f}",
        "row": "10,000",
        "rowms": f"{times[row, 'jaxnc'] / 1e6:.1f}",
        "engines": "\n".join(
            f"| {e['engine']}, {e['setting']} | {e['error']:.1e} | {e['seconds']:.2g} |" for e in engines
        ),
        "engine": dynamics["machine"]["cpu"].partition(" (")[0],
        "designs": f"{times['designs', 'jaxnc']:.0f}",
        "ensemble": f"{times['designs', 'pylinkage Ensemble']:.0f}",
        "points": "25",
        "error": f"{max(run['error'] for run in runs):.5f}",
        "known": re.search(r": (0\.\d+)", runs[0]["known"])[1],  # pyright: ignore[reportOptionalSubscript]
        "keys": str(len(runs)),
        "seconds": f"{statistics.median(run['processor_s'] for run in runs):.0f}",
        "poses": re.search(r"(\d+) poses", values["case"])[1],  # pyright: ignore[reportOptionalSubscript]
        "value": f"{values['processor_s']:.2f}",
        "both": f"{both['processor_s']:.2f}",
    }


def text() -> str:
    """The paper."""
    found = numbers()
    return re.sub(r"@(\w+)@", lambda mark: found[mark[1]], TEXT)


if __name__ == "__main__":
    PAGE.write_text(text(), encoding="utf-8", newline="\n")
    print(f"wrote {PAGE.relative_to(HERE.parent)}")
