"""Every kind of force the library knows, by name."""

from jaxnc.forces import loads, springs
from jaxnc.forces.kind import ForceKind
from jaxnc.pickling import register_by_name

CATALOGUE: dict[str, ForceKind] = {
    kind.name: kind
    for kind in (
        springs.SPRING,
        springs.DAMPER,
        springs.STOP,
        springs.COORDINATE_SPRING,
        springs.COORDINATE_DAMPER,
        springs.COORDINATE_STOP,
        loads.FORCE,
        loads.FORCE_IN_SPACE,
        loads.EFFORT,
        loads.COUPLE,
    )
}
register_by_name(__name__, CATALOGUE.values())
