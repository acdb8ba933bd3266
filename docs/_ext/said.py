"""What the tables say of what has no docstring of its own. `tables.py` sees that nothing is missing or idle."""

import jaxnc as nc
from jaxnc import synthesis
from jaxnc.io import source
from jaxnc.io.curve_files import outline
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record

PACKAGES = {  # pages of the reference, in this order
    "jaxnc": "What is used most: `import jaxnc as nc`.",
    "jaxnc.kinematics": "What motions and reports hold, and what is asked for less often.",
    "jaxnc.vehicle": "Wheel suspensions: what is read off a motion, and reports.",
    "jaxnc.dynamics": "What simulations and reactions hold; masses, energies, momenta.",
    "jaxnc.synthesis": "Design: problems, conditions, searches, exact synthesis, tolerances.",
    "jaxnc.library": "Ready mechanisms.",
    "jaxnc.library.benchmarks": "Published problems of multibody dynamics, with their dimensions.",
    "jaxnc.families": "Other families of coordinates, and what compares them.",
    "jaxnc.constraints": "Kinds of constraints, and what a kind of your own is made of.",
    "jaxnc.forces": "Kinds of forces, and what a kind of your own is made of.",
    "jaxnc.system": "What `compile()` makes, and its equations.",
    "jaxnc.io": "Tables, and outlines from drawings.",
    "jaxnc.robots": "Files of robot simulators, in and out.",
    "jaxnc.workshop": "Parts of planar mechanisms for a workshop, as plates in layers.",
    "jaxnc.viz": "Drawings, plots, films and pages.",
    "jaxnc.reporting": "Reports: a page for people, a verdict for machines.",
}

INSIDE = ("jaxnc.cli", "jaxnc.mechanism", "jaxnc.reading", "jaxnc.solvers")  # no packages of a user

BODIES = {  # dimension: name, and how many points and vectors, whether in one line, whether in one plane
    2: {
        "2 points (bar)": (2, 0, False, False),
        "3 points": (3, 0, False, False),
        "3 points in line": (3, 0, True, False),
        "4 points": (4, 0, False, False),
        "5 points": (5, 0, False, False),
    },
    3: {
        "2 points (bar)": (2, 0, False, False),
        "1 point, 2 vectors": (1, 2, False, False),
        "2 points, 1 vector": (2, 1, False, False),
        "2 points, 1 vector along them (bar)": (2, 1, True, False),
        "3 points": (3, 0, False, False),
        "3 points in line (bar)": (3, 0, True, False),
        "2 points, 2 vectors": (2, 2, False, False),
        "2 points, 2 vectors in one plane": (2, 2, False, True),
        "4 points": (4, 0, False, False),
        "3 points, 2 vectors": (3, 2, False, False),
        "5 points": (5, 0, False, False),
    },
}

JOINTS = {
    "revolute": "plane, space",
    "prismatic": "plane, space",
    "slot": "plane, space",
    "gear": "plane",
    "rolling": "plane, space",
    "cable": "plane, space",
    "weld": "plane, space",
    "spherical": "space",
    "cylindrical": "space",
    "universal": "space",
    "screw": "space",
    "planar": "space",
    "bevel gear": "space",
    "rack and pinion": "space",
    "constant velocity": "space",
    "skate": "plane",
    "rolling disc": "space",
}

COORDINATES = {
    "P.x, P.y, P.z": "of a point, `m.point`; those of `m.ground`, and those that `fixed=` names, are no unknowns",
    "u.x, u.y, u.z": "components of a unit vector, `m.vector`, in space; its length is a row",
    "phi": "an angle, `m.angle`: one unknown and one row more; rad",
    "s": "a distance, `m.distance`: one unknown and one row more",
    "E.x": "of a marker, `m.marker`: rides on a body, is read and plotted, and is no unknown",
}

FORMS = {
    "exact": "one row that is valid everywhere; of an angle through any number of turns, of a distance signed",
    "cosine": "as the text, from the scalar product; loses its grip at 0 and π",
    "sine": "as the text, from the vector product; loses its grip at ±π/2",
    "sine x": "the x component of the vector product",
    "sine y": "the y component",
    "sine z": "the z component",
    "sines": "all three components of the vector product",
    "switched": "whichever of the text's forms has the better grip, chosen in every step",
    "redundant": "all of the text's forms, met together",
    "sum": "the sum of the text's two forms",
    "difference": "their difference",
    "x": "as the text, by the x component of the line",
    "y": "by the y component",
    "z": "by the z component",
}

FORCES = {
    "spring": "force against lengthening: preload + stiffness x + cubic x³, x the length less `free`",
    "damper": "force against lengthening: damping ẋ + quadratic ẋ |ẋ|",
    "stop": "beyond `lower` or `upper`: stiffness times the depth, and damping that grows with the depth",
    "coordinate spring": "the same of an angle, a distance or a single coordinate",
    "coordinate damper": "the same of an angle, a distance or a single coordinate",
    "coordinate stop": "the same of an angle, a distance or a single coordinate",
    "force": "a constant force on a point, N",
    "force in space": "a constant force on a point, N",
    "effort": "a constant torque on an angle, N m, or force on a distance or coordinate, N",
    "couple": "a constant couple on the body of two points, N m",
}

LOADS = dict.fromkeys(
    ("spring", "damper", "stop", "force", "torque", "load", "apply", "friction", "mass", "point_mass"), ""
)

ANALYSES = {
    "solve_position": nc.solve_position,
    "sweep": nc.sweep,
    "motion": nc.motion,
    "circuit": nc.circuit,
    "travel": nc.travel,
    "diagnose": nc.diagnose,
    "mobility": nc.mobility,
    "sensitivity": nc.sensitivity,
    "stream": nc.stream,
    "tolerance": nc.tolerance,
    "simulate": nc.simulate,
    "inverse_dynamics": nc.inverse_dynamics,
    "equilibrium": nc.equilibrium,
    "linearise": nc.linearise,
    "synthesis.solve": synthesis.solve,
    "synthesis.descend": synthesis.descend,
    "synthesis.pareto": synthesis.pareto,
}


def where(name: str) -> str:
    """The full name of an analysis."""
    return f"jaxnc.{name}"


ADAPTIVE = ("dopri8", "kvaerno5")

METHODS = {
    "dopri8": "Dormand and Prince, order 8, index 1; every step ends on the constraints (default)",
    "kvaerno5": "Kværnø, implicit, order 5: stiff forces in small mechanisms",
    "rk4": "Runge and Kutta, position and velocity projected; the one for batches",
    "generalised alpha": "index 3, spectral radius 0.7: the one for stiff mechanisms",
}

EXITS = {
    "0": "good",
    "1": "the mechanism could not be moved, or designed, as asked",
    "2": "bad input: one line on stderr says what",
    "130": "interrupted by Ctrl-C",
}

STATUSES = {
    "CONVERGED": "nothing",
    "DID_NOT_ASSEMBLE": "`nc.diagnose(system, inputs)` names what is in the way and the smallest change that closes it",
    "SINGULAR": "`nc.travel` says how far the input goes; `nc.circuit` goes through dead points; or drive another",
    "BRANCH_JUMP": "ask without `branch=`, or for the other assembly by `start=`",
    "NOT_REACHED": "look at the first pose that failed: its status says why the motion stopped there",
    "MIRRORED": "use the default form of the body, which has no mirrored twin",
    "LEFT_CLASS": "compile the mechanism anew with the changed drawing",
    "TOO_FAR": "give poses in between; in traced code leave `repair=True`",
    "SINGULAR_START": "draw the mechanism a little off, on the side that is meant, or name points in `start=`",
    "STEP_UNDERFLOW": "look where and at which force the message points; a method of fixed step, a softer force",
    "TOO_MANY_STEPS": '`most=` allows more; for stiff forces `method="generalised alpha"` or `"kvaerno5"`',
    "STOPPED": "nothing: `run.end` is when and where the event was",
    "CAME_APART": "a shorter `step=`, or an adaptive method; `singular=True` where rows become redundant on the way",
}

ERRORS = {
    "JaxncError": "catch this one to catch all that follow",
    "MechanismError": "mend the description: the text names the point, body or joint, and what was expected",
    "ModelFileError": "mend the file: the text has file, line and entry, and the nearest name that would be known",
    "CallError": "change the call: the text says which argument is missing, unknown or of another kind, and what fits",
    "UnknownName": "the object has no method or value of that name; the text says which one is nearest",
    "InputError": "change the call: wrong inputs, names, shapes or units; in traced code it is raised too",
    "WrongCount": "drive as many coordinates as there are freedoms, or name those that stay in `hold=`",
    "AssemblyError": "`nc.diagnose` and `nc.travel` say why; `throw=False`, or a batch, makes it a status instead",
    "OutputError": "the folder cannot be written: choose another path",
}

MESSAGES = {  # what the library's source says, "…" for what is filled in
    "jaxnc needs 64-bit numbers, and JAX has them switched off": "write the line that it gives at the top of the "
    'program, before the first computation; or `compile(dtype="float32")` for six digits',
    "too few inputs: … Drive or hold": "each freedom needs a value: `nc.mobility(system)` counts them, and names "
    "freedoms that were not meant",
    "too many inputs: … of them out": "drive no more coordinates than there are freedoms",
    "Even the drawing does not assemble": "explicit lengths contradict the drawing, or each other: leave `lengths=` "
    "out, or draw nearer to them; `nc.diagnose(system, inputs)` names them",
    "Along the branch of the drawing it can be moved as far as": "the input ends at a dead point: `nc.travel`",
    "works outside of traced code only": "call it outside of `jit`, `grad` and `vmap`, and return what it needs",
    "is overconstrained: changed alone": "such a mechanism moves for special dimensions only; ask for `variables=` "
    "that keep it moving",
    "a drawing is made of numbers": "build and compile once, outside, and change the system: `system.replace({…})`",
    "the name is already taken": "names are shared by points, vectors, markers and coordinates: choose another",
    "is a marker, which only rides on a body": 'make it a point of the body: `m.point` and `m.body(…, ["A", "P"])`',
    "angles are in radians here": 'angles are in radians: `np.radians`, or `unit="deg"`',
}

PLOTS = {  # of the pendulum that `tables.plots` builds
    "B": "path of a point or marker in the plane, its components in space",
    "B.x": "one coordinate of a point",
    "phi": "an angle or distance of the mechanism",
    "time": "of a motion in time",
    "velocity B": "rate of a point",
    "velocity B.x": "one component of it",
    "velocity phi": "rate of a coordinate",
    "acceleration B": "second rate",
    "acceleration phi": "second rate of a coordinate",
    "jerk B": "third rate",
    "orientation bar": "the angle of a body's first line from the x axis, in the plane; it goes on beyond a turn",
    "angular velocity bar": "of a body",
    "angular acceleration bar": "of a body",
    "energy": "kinetic and potential energy together",
    "kinetic energy": "of all masses",
    "potential energy": "of weights and springs",
    "effort phi": "what an input takes",
    "load return": "what a spring, damper, stop, actuator or friction does",
    "support A": "force of the ground on a fixed point",
    "reaction A on bar": "what acts on a body where it holds a point",
}

EXERTED = {  # axis, unit, kind
    "effort": ("torque, force", "N m of an angle, N", "number"),
    "load": ("force, torque", "N, N m of an angle", "number, or vector of a force on a point"),
    "support": ("force", "N", "vector"),
    "reaction": ("force", "N", "vector"),
}

TABLES = {
    "name": "what reports and pictures call it",
    "dim": "2 in the plane, 3 in space",
    "description": "a line about it",
    "units": "labels and the unit of angles",
    "ground": "points of the ground, by name",
    "points": "moving points as drawn, by name; fixed in part as a table",
    "ground_vectors": "unit vectors of the ground, in space",
    "vectors": "unit vectors of bodies, in space",
    "bodies": "points of each body, or a table",
    "markers": "points and unit vectors that ride on bodies",
    "angles": "angles that are coordinates: [coordinates](coordinates.md)",
    "distances": "distances that are coordinates: [coordinates](coordinates.md)",
    "joints": "joints, each with `joint = …`: [joints](joints.md)",
    "relations": "linear relations of coordinates: [joints](joints.md#relation)",
    "constraints": "kinds of your own: [joints](joints.md#constraint)",
    "gravity": "acceleration of free fall, a vector",
    "masses": "masses concentrated in points",
    "forces": "springs, dampers, stops, loads: [kinds](forces.md)",
    "friction": "friction in joints",
    "simulate": "what `jaxnc simulate` does",
    "run": "what `jaxnc run` does",
}

RECORDS = {
    "[points]": (record.Point, Mechanism.point),
    "[bodies]": (record.Body, Mechanism.body),
    "[markers]": (record.Marker, Mechanism.marker),
    "[masses]": (record.PointMass, Mechanism.point_mass),
    "[forces]": (record.Force, Mechanism.apply),
    "[friction]": (record.Friction, Mechanism.friction),
    "[units]": (record.Units, None),
    "[run]": (record.Run, None),
    "[run.inputs]": (record.Drive, None),
    "[simulate]": (record.Simulation, nc.simulate),
}

PROBLEMS = {
    "At the top": (source.ProblemFile, synthesis.PathGeneration.__init__),
    "[[conditions]]": (source.ConditionEntry, None),
    "[search]": (source.SearchOptions, synthesis.solve),
    "target = { svg = … }": (source.SvgTarget, outline),
}

KEYS_AS = {  # keys that the builder's methods call otherwise
    "Friction.point": "at",
    "SvgTarget.svg": "path",
    "SvgTarget.points": "count",
}

_PAIR = "a point of each body"
KEYS = {
    "Revolute.points": _PAIR,
    "Spherical.points": _PAIR,
    "Universal.points": "a point of each body, where they do not share the centre of the cross",
    "ConstantVelocity.points": "a point of each shaft, where they do not share one",
    "Gear.angles": "the angles that measure the rotation of the two wheels",
    "BevelGear.angles": "the angles that measure the rotation of the two wheels",
    "Weld.bodies": "the two bodies",
    "Units.length": "a label for reports and plots",
    "Units.angle": "what angles of the run section are in",
    "Run.inputs": "what is driven, by name",
    "Run.hold": "free coordinates that keep their start values",
    "Run.analysis": "in order along the branch, every pose on its own, or through dead points",
    "Run.outputs": "points, markers and coordinates that are reported; a choice if none are given",
    "Drive.from": "first value",
    "Drive.to": "last value",
    "Drive.poses": "how many",
    "Drive.rate": "constant rate, per second: gives velocities and accelerations",
    "Simulation.duration": "seconds",
    "Simulation.times": "how many times are kept",
    "Simulation.start": "values at the start, of as many coordinates as there are freedoms",
    "ProblemFile.mechanism": "the model file of the starting idea",
    "ProblemFile.kind": "which problem: [guide](../synthesis.md#problems)",
    "ProblemFile.output": "of a function: a coordinate, or a number of a suspension",
    "ProblemFile.body": "of a motion: the body that is guided",
    "ProblemFile.values": "of a function: the input's value at each target, where the target has no column of them",
    "ProblemFile.orientations": "of a motion: angles, in space rotation vectors",
    "ProblemFile.input_offset": "of a function: the input counts from a value that is free",
    "ProblemFile.output_offset": "of a function: the output counts from a value that is free",
    "ProblemFile.conditions": "what designs must meet, below",
    "ProblemFile.search": "how long to search, below",
    "ConditionEntry.type": "which condition: [guide](../synthesis.md#conditions)",
    "ConditionEntry.kind": "crank turns: which of the two",
    "ConditionEntry.margin": "crank turns: by how much, in parts of the size; clear of, clear links: a length",
    "ConditionEntry.min": "transmission angle, length, direction: at least",
    "ConditionEntry.max": "length, size, direction: at most",
    "ConditionEntry.joint": "transmission angle, circuit: three points, the joint in the middle",
    "ConditionEntry.points": "names of the points it is about",
    "ConditionEntry.other": "equal: the other two points",
    "ConditionEntry.value": "equal, direction: the value",
    "ConditionEntry.about": "symmetric: a line, by two points; the y axis if not given",
    "ConditionEntry.variable": "integer, stock: the design variable",
    "ConditionEntry.sizes": "stock: the sizes that there are",
    "ConditionEntry.step": "integer: the step",
    "ConditionEntry.side": "circuit: which one",
    "ConditionEntry.point": "within, local: the point",
    "ConditionEntry.x": "within: from, to; local: the value",
    "ConditionEntry.y": "within: from, to; local: the value",
    "ConditionEntry.z": "within: from, to",
    "ConditionEntry.region": "clear of: corners of a polygon, or two opposite ones of a box",
    "ConditionEntry.links": "clear of: names of bodies; all that move if not given",
    "ConditionEntry.layers": "clear links: the layer of each body, or bodies of one layer",
    "ConditionEntry.width": "clear of, clear links: of the links",
    "ConditionEntry.distance": "no flip: how far points move into another assembly, at least; a length",
    "ConditionEntry.input": "no flip: how far dead points are, at least; in the unit of the input",
    "ConditionEntry.stops": 'only circuit: coordinates and between what they stay, `{ "C.y" = [0, inf] }`',
}
