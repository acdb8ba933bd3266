"""Masses and forces of a model file, handed to the builder; what of them a file cannot hold."""

import math

from jaxnc.errors import InputError, MechanismError, nearest
from jaxnc.io.source import Source
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record


def add_loads(m: Mechanism, model: record.Model, source: Source) -> None:
    """Call the builder for gravity, point masses, forces and frictions, and check the simulation section."""
    with source.blamed(("gravity",)):
        m.gravity = model.gravity
    for name, mass in model.masses.items():
        with source.blamed(("masses", name)):
            m.point_mass(name, mass.point, mass.mass)
    for name, f in model.forces.items():
        from jaxnc.forces import CATALOGUE  # and JAX with it, which a model without forces can do without

        with source.blamed(("forces", name)):
            kind = CATALOGUE.get(f.kind)
            if kind is None:
                raise MechanismError(f"force {name!r}: unknown kind {f.kind!r}; {nearest(f.kind, CATALOGUE)}")
            m.apply(name, kind, f.points, f.vectors, f.scalars, f.parameters)
    for name, f in model.friction.items():
        with source.blamed(("friction", name)):
            m.friction(
                name,
                coefficient=f.coefficient,
                bodies=f.bodies,
                at=f.point,
                radius=f.radius,
                joint=f.joint,
                speed=f.speed,
            )
    section = model.simulate
    names = (*m.all_points, *m.all_vectors, *m.scalar_names, *(f"{p}.{a}" for p in m.all_points for a in m.axes))
    for key, values in (("start", section.start), ("rates", section.rates)):
        for name, value in values.items():
            with source.blamed(("simulate", key, name)):
                if name not in names:
                    raise InputError(f"there is no coordinate {name!r}; {nearest(name, names)}")
                if not math.isfinite(value):
                    raise InputError(f"{key} of {name!r} must be a finite number")
    for key in ("duration", "step", "rtol"):
        value = getattr(section, key)
        with source.blamed(("simulate", key)):
            if value is not None and not (math.isfinite(value) and value > 0):
                raise InputError(f"{key} = {value} must be a positive number")
    with source.blamed(("simulate", "times")):
        if section.times < 2:
            raise InputError(f"times = {section.times}; keep at least 2")
    m.model.simulate = section


def check_savable(m: Mechanism) -> None:
    """Refuse forces that are functions or of the user's own kinds."""
    for name, f in m.model.forces.items():
        if f.kind.startswith("function: "):
            raise MechanismError(
                f"force {name!r} is a function, which a file cannot hold; save the mechanism without it, and add it "
                f"again after load()"
            )
        from jaxnc.forces import CATALOGUE

        if m.force_kinds.get(f.kind) != CATALOGUE.get(f.kind):
            raise MechanismError(
                f"force {name!r} is of your own kind {f.kind!r}, which a file cannot hold; add it after load()"
            )
