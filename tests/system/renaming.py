"""Any mechanism with everything in it called otherwise: by names that kinds of things share, or that read as text."""

import copy
from typing import Any

import numpy as np

import jaxnc as nc
from jaxnc.mechanism import model as record

QUANTITIES = ["length1", "radius2", "x", "y2", "and", "phi", "ground", "joint", "inertia", "mass", "fixed", "reaction"]
"""What points, vectors, markers and coordinates are called: they share one name space, and have no spaces or dots."""

OTHERS = ["a and b", "a", "b", "a: b", "a.x", "of b", "joint a", "relation a", "gravity", "slider crank"]
"""What everything else may be called besides."""


class Renamed:
    """A mechanism under other names, chosen at random.

    Args:
        mechanism: the mechanism.
        rng: random numbers.
    """

    def __init__(self, mechanism: nc.Mechanism, rng: np.random.Generator):
        m = mechanism.model
        own = [*mechanism.all_points, *mechanism.all_vectors, *m.markers, *mechanism.scalar_names]
        more = [f"q{k}" for k in range(len(own))]
        self.quantities = dict(zip(own, self.drawn(rng, QUANTITIES, more, len(own)), strict=True))
        pool = [*OTHERS, *self.quantities.values()]
        self.bodies, self.joints, self.relations, self.constraints, self.masses, self.forces, self.frictions = (
            dict(zip(table, self.drawn(rng, [n for n in pool if n != "ground"], more, len(table)), strict=True))
            for table in (m.bodies, m.joints, m.relations, m.constraints, m.masses, m.forces, m.friction)
        )
        self.bodies["ground"] = "ground"
        self.mechanism = copy.copy(mechanism)
        self.mechanism.members = {}
        self.mechanism.model = out = copy.deepcopy(m)
        out.run, out.simulate = record.Run(), record.Simulation()
        for table in ("ground", "points", "ground_vectors", "vectors", "markers", "angles", "distances"):
            setattr(out, table, {self.quantities[n]: self.of(x) for n, x in getattr(m, table).items()})
        for table in ("bodies", "joints", "relations", "constraints", "masses", "forces"):
            names = getattr(self, table)
            setattr(out, table, {names[n]: self.of(x) for n, x in getattr(m, table).items()})
        out.friction = {self.frictions[n]: self.of(x) for n, x in m.friction.items()}

    @staticmethod
    def drawn(rng: np.random.Generator, names: list[str], more: list[str], count: int) -> list[str]:
        """Some of the names, all different."""
        names = list(dict.fromkeys(names))
        return [str(n) for n in rng.permutation([*names, *[n for n in more if n not in names]])[:count]]

    def quantity(self, name: str) -> str:
        """The new name of a point, vector, marker or coordinate, or of one component of it."""
        stem, dot, axis = name.partition(".")
        return self.quantities[stem] + dot + axis

    def of(self, what: Any) -> Any:
        """A record with its names exchanged."""
        if isinstance(what, str):
            return self.quantity(what)
        if isinstance(what, (list, tuple)):
            return type(what)(self.of(x) if isinstance(x, (str, list, tuple)) else x for x in what)
        out = copy.deepcopy(what)
        for field in what.__struct_fields__:
            value: Any = getattr(what, field)
            if isinstance(what, record.Marker) and field == "on":
                out.on = self.bodies[value]
            elif field == "bodies":
                out.bodies = value and tuple(self.bodies[b] for b in value)
            elif isinstance(what, record.Friction) and field == "joint":
                out.joint = None if value is None else self.joints[value]
            elif field == "lengths":
                out.lengths = {"-".join(self.quantity(p) for p in key.split("-")): x for key, x in value.items()}
            elif field in ("local", "terms"):
                setattr(out, field, {self.quantity(key): x for key, x in value.items()})
            elif field not in ("form", "shape", "kind", "fixed", "constants", "parameters") and isinstance(
                value, (str, list, tuple)
            ):
                setattr(out, field, self.of(value))
        return out
