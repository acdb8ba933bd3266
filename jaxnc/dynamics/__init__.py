"""Motion under forces: mass matrices, simulation, inverse dynamics, reactions, equilibrium, vibration."""

import importlib

_HOME = {
    "energy": (
        "angular_momentum",
        "centre_of_mass",
        "energy",
        "kinetic_energy",
        "momentum",
        "potential_energy",
        "total_mass",
    ),
    "inertia": ("mass_matrix",),
    "model": ("Dynamics", "dynamics", "forces"),
    "simulate": ("simulate",),
    "simulation": ("Simulation",),
    "state": ("State",),
}
_WHERE = {name: module for module, names in _HOME.items() for name in names}


def __getattr__(name: str):
    if name in _WHERE:
        return getattr(importlib.import_module(f"jaxnc.dynamics.{_WHERE[name]}"), name)
    raise AttributeError(f"module 'jaxnc.dynamics' has no attribute {name!r}")


def __dir__() -> list[str]:
    return list(_WHERE)
