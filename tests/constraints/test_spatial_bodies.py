"""Rigid bodies in space: rows and ranks of every form of §4.1, invariance, mirror images, classes, explicit lengths."""

import functools

import jax
import numpy as np
import pytest

import jaxnc as nc
from jaxnc.solvers.assembly import derive
from jaxnc.status import Status
from jaxnc.system.assemble import assemble

QUICK = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}  # compiled once, run little
ROUNDING = 1e-12  # of sizes about 3, in rows that are lengths

A, B, C, D = (np.array(x) for x in ((0.1, 0.2, -0.3), (1.2, 0.5, 0.4), (0.3, 1.1, 0.8), (-0.6, 0.4, 1.3)))
MORE = [np.array(x) for x in ((0.9, -0.7, 0.2), (-0.4, -0.5, -0.8), (0.6, 0.9, -1.1))]
U, V, W = (np.array(x) for x in ((0.2, 0.3, 0.9), (0.8, -0.5, 0.1), (-0.3, 0.7, 0.4)))

# name: (points, vectors, written rows, freedoms); every row is independent, in both forms
BODIES = {
    "two points (89)": ([A, B], [], 1, 5),
    "point and vector": ([A], [U], 1, 5),
    "point and two vectors": ([A], [U, V], 3, 6),
    "two points and vector (90)-(92)": ([A, B], [U], 3, 6),
    "two points and vector across": ([A, B], [np.cross(B - A, U)], 3, 6),
    "two points and vector aligned (93)-(96)": ([A, B], [B - A], 4, 5),
    "two points and vector back along the line": ([A, B], [A - B], 4, 5),
    "three points (97)-(99)": ([A, B, C], [], 3, 6),
    "three points aligned (100)-(103)": ([A, B, A + 1.7 * (B - A)], [], 4, 5),
    "three points aligned, one between": ([A, B, A + 0.4 * (B - A)], [], 4, 5),
    "three points and two vectors in one line": ([A, B, 2 * A - B], [B - A, A - B], 10, 5),
    "three points aligned and vector across": ([A, B, A + 1.7 * (B - A)], [U], 6, 6),
    "two points and two vectors (104)-(109)": ([A, B], [U, V], 6, 6),
    "two points and two vectors in a plane (110)-(115)": ([A, B], [U, 0.7 * (B - A) - 0.5 * U], 6, 6),
    "four points": ([A, B, C, D], [], 6, 6),
    "four points in a plane": ([A, B, C, 0.3 * A + 1.2 * B - 0.5 * C], [], 6, 6),
    "four points of a rectangle": ([A, A + U, A + np.cross(U, V), A + U + np.cross(U, V)], [], 6, 6),
    "two points at one place": ([A, B, C, A], [], 6, 6),
    "three vectors and a point": ([A], [U, V, W], 6, 6),
    "four points and two vectors, figure 31 (116)-(127)": ([A, B, C, D], [U, V], 12, 6),
    "seven points and three vectors": ([A, B, C, D, *MORE], [U, V, W], 24, 6),
    "seven points in a plane": (
        [A + x * U + y * V for x, y in np.random.default_rng(1).normal(size=(7, 2))],
        [],
        15,
        6,
    ),
}
# Bodies by the letters of their points and vectors, which they share; what is on the ground; written rows, freedoms.
SHARING = [
    ({"one": "ABu", "two": "ACu"}, "", 5, 7),  # hinge: the norm of u is written once
    ({"one": "ABC", "two": "ABD"}, "", 5, 7),  # hinge of two points: its length once
    ({"one": "Auv", "two": "Buv"}, "", 3, 9),  # two vectors: bodies that do not turn relative to each other
    ({"one": "Auv", "two": "Buv", "three": "Cuv"}, "", 3, 12),
    ({"one": "Auv", "two": "Bvw", "three": "Cwu"}, "", 6, 12),  # in a ring
    ({"one": "ABu", "two": "CDu", "three": "EFu"}, "", 7, 14),  # one vector in three bodies
    ({"one": "ABCu", "two": "ABDu"}, "", 9, 6),  # three directions shared: they are one body
    ({"one": "Auvw", "two": "Buvw"}, "", 6, 9),
    ({"one": "ABu", "two": "BCuv", "three": "CDv"}, "", 10, 8),  # a chain of hinges
    ({"one": "ABu"}, "Au", 2, 1),  # a crank on the ground
    ({"one": "ABC"}, "AB", 2, 1),
    ({"one": "ABCu", "two": "ABCDu"}, "ABCu", 3, 0),  # one on the ground, one fixed to it
    ({"one": "ABuv"}, "ABuv", 0, 0),
    ({"one": "AB", "two": "BC", "three": "CA"}, "", 3, 6),  # bars that make a triangle
    ({"one": "ABCD", "two": "ABCE"}, "", 9, 6),
]
CASES = [(name, form) for name in BODIES for form in ("exact", "text")]


def turned(rng):
    """A random rotation."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.linalg.det(q)


def share(m, prefix, bodies, ground, form):
    """Bodies that share what they have in common."""
    rng = np.random.default_rng(21)
    for name in dict.fromkeys("".join(bodies.values())):
        place = rng.normal(size=3)
        if name.islower():
            (m.ground_vector if name in ground else m.vector)(prefix + name, place)
        else:
            (m.ground if name in ground else m.point)(prefix + name, place)
    for name, items in bodies.items():
        points, vectors = ([prefix + i for i in items if i.islower() == lower] for lower in (False, True))
        m.body(prefix + name, points, vectors=vectors, form=form)


class Bench:
    """Every body in every form in one mechanism."""

    def __init__(self):
        m = nc.Mechanism("bodies", dim=3)
        for k, (name, form) in enumerate(CASES):
            points, vectors, *_ = BODIES[name]
            for i, at in enumerate(points):
                m.point(f"b{k}_P{i}", at)
            for i, direction in enumerate(vectors):
                m.vector(f"b{k}_u{i}", direction)
            names = [f"b{k}_P{i}" for i in range(len(points))], [f"b{k}_u{i}" for i in range(len(vectors))]
            m.body(f"b{k}", names[0], vectors=names[1], form=form)
        for k, (bodies, ground, *_) in enumerate(SHARING):
            for form in ("exact", "text"):
                share(m, f"s{k}{form}_", bodies, ground, form)
        self.system = assemble(m)
        self.top = self.system.topology
        self.look = jax.jit(
            lambda eq, q: (nc.system.residual(eq, q), nc.system.jacobian(eq, q)), compiler_options=QUICK
        )
        self.eq = derive(self.system)
        self.home = np.array(self.eq.home)
        self.cut = 3 * len(self.top.points)
        self.residual, self.jacobian = map(np.asarray, self.look(self.eq, self.home))

    def rows(self, start):
        return [i for i, row in enumerate(self.top.rows) if row.startswith(start)]

    def columns(self, start):
        return [i for i in self.top.unknown if self.top.coordinates[i].startswith(start)]

    def place(self, q, rotation, t=0.0, scale=1.0):
        """All bodies moved (and scaled) together; vectors keep their length."""
        points, vectors = q[: self.cut].reshape(-1, 3), q[self.cut :].reshape(-1, 3)
        return np.concatenate([(scale * points @ rotation.T + t).reshape(-1), (vectors @ rotation.T).reshape(-1)])


@pytest.fixture(scope="module")
def bench():
    return Bench()


@pytest.mark.parametrize(("name", "form"), CASES)
def test_rows_and_rank(bench, name, form):
    points, vectors, written, freedoms = BODIES[name]
    k, n = CASES.index((name, form)), 3 * (len(points) + len(vectors))
    rows, columns = bench.rows(f"b{k}:"), bench.columns(f"b{k}_")
    assert len(columns) == n and len(rows) == written == n - freedoms
    jacobian = bench.jacobian[np.ix_(rows, columns)]
    values = np.linalg.svd(jacobian, compute_uv=False)
    assert values[-1] > 0.02, "every row is independent"
    assert np.abs(bench.residual[rows]).max() < ROUNDING
    # What is left is what a rigid body can do.
    twists = []
    for w in np.eye(3):
        spin = [np.cross(w, x) for x in (*points, *(v / np.linalg.norm(v) for v in vectors))]
        step = [*(w for _ in points), *(np.zeros(3) for _ in vectors)]
        twists += [np.concatenate(spin), np.concatenate(step)]
    assert np.abs(jacobian @ np.array(twists).T).max() < ROUNDING


def test_rigid_motions_leave_the_rows_unchanged(bench):
    """Assembled bodies stay assembled; of others every instance's misclosure turns with the body."""
    rng = np.random.default_rng(3)
    bad = bench.home + 0.1 * rng.normal(size=len(bench.home))
    groups = [r for layout in bench.top.layout for r in layout.rows if r.size]

    def sizes(q):
        r = np.asarray(bench.look(bench.eq, q)[0])
        return np.array([np.linalg.norm(r[g]) for g in groups])

    want = sizes(bad)
    assert want.max() > 0.1
    for _ in range(5):
        motion = turned(rng), rng.normal(size=3)
        assert sizes(bench.place(bench.home, *motion)).max() < ROUNDING
        np.testing.assert_allclose(sizes(bench.place(bad, *motion)), want, atol=ROUNDING)
    mirrored = bench.place(bench.home, np.diag([1.0, 1.0, -1.0]))
    r = np.asarray(bench.look(bench.eq, mirrored)[0])
    for k, (name, form) in enumerate(CASES):
        points, vectors, *_ = BODIES[name]
        spread = np.linalg.matrix_rank(np.array([*(p - points[0] for p in points), *vectors]), tol=1e-6)
        seen = np.abs(r[bench.rows(f"b{k}:")]).max()
        assert (seen > 0.05) == (spread == 3 and form == "exact"), (name, form)


def test_scaling_scales_the_rows(bench):
    rng = np.random.default_rng(4)
    bad = bench.home + 0.1 * rng.normal(size=len(bench.home))
    want = np.asarray(bench.look(bench.eq, bad)[0])
    for factor in (1e-3, 250.0):
        points = {name: factor * np.asarray(bench.system[name]) for name in bench.top.points}
        eq = derive(bench.system.replace(points))
        got = np.asarray(bench.look(eq, bench.place(bad, np.eye(3), scale=factor))[0])
        np.testing.assert_allclose(got / factor, want, atol=ROUNDING)


# ---------------------------------------------------------------------------------------------------------------
# what bodies share


@pytest.mark.parametrize("form", ["exact", "text"])
@pytest.mark.parametrize("k", range(len(SHARING)), ids=["-".join(bodies.values()) for bodies, *_ in SHARING])
def test_shared_rows_are_written_once(bench, k, form):
    _, _, written, freedoms = SHARING[k]
    rows, columns = bench.rows(f"s{k}{form}_"), bench.columns(f"s{k}{form}_")
    names = [bench.top.rows[i] for i in rows]
    assert len(rows) == written == len(set(names)), names
    assert len(columns) - written == freedoms
    if written:
        assert np.linalg.svd(bench.jacobian[np.ix_(rows, columns)], compute_uv=False)[-1] > 0.01, names


# ---------------------------------------------------------------------------------------------------------------
# mirror images, classes, explicit lengths


@functools.cache
def still():
    """Bodies on three ground points, and others along the axes: nothing moves, everything is solved for."""
    m = nc.Mechanism("still", dim=3)
    for name, at in (("A", (0, 0, 0)), ("B", (1, 0, 0)), ("C", (0.2, 1, 0))):
        m.ground(name, at)
    m.point("P", (0.3, 0.4, 0.8))
    m.vector("w", (0.1, -0.3, 1))
    m.body("tetrahedron", ["A", "B", "C", "P"], vectors=["w"], form="text")
    m.point("Q", (0.3, 0.4, 0.8))
    m.vector("v", (0.1, -0.3, 1))
    m.body("block", ["A", "B", "C", "Q"], vectors=["v"])
    m.point("K", (2.5, 0, 0))
    m.body("rod", ["A", "B", "K"])
    m.point("L", (0.6, 0.7, 0))
    m.body("plate", ["A", "B", "C", "L"], form="text")
    m.point("X", (2.2, 0, 0), fixed="yz")
    m.body("bar", ["A", "X"], lengths={("A", "X"): 2.5})
    m.point("Y", (2, 0, 0), fixed="yz")
    m.point("Z", (1, 1.4, 0), fixed="z")
    m.body("triangle", ["A", "Y", "Z"], lengths={("A", "Y"): 2.1, ("Z", "A"): 1.8, ("Y", "Z"): 1.6})
    return m.compile()


def pose(system, **guess):
    return nc.solve_position(system, {}, start=guess, throw=False)


@pytest.mark.slow
def test_a_mirrored_guess():
    """The text's base of three segments has a mirrored twin, which is a status; the exact form has none."""
    start = {name: still()[name] for name in "PQKLXYZwv"}
    found = pose(still(), **start)
    assert Status(int(found.status)) is Status.CONVERGED
    flip = np.array([1.0, 1.0, -1.0])
    found = pose(still(), **{**start, "P": start["P"] * flip, "w": start["w"] * flip})
    assert Status(int(found.status)) is Status.MIRRORED and "mirror image" in Status.MIRRORED.sentence
    found = pose(still(), **{**start, "Q": start["Q"] * flip, "v": start["v"] * flip})
    assert Status(int(found.status)) is Status.CONVERGED
    np.testing.assert_allclose(found["Q"], (0.3, 0.4, 0.8), atol=1e-12)
    np.testing.assert_allclose(found["v"], still()["v"], atol=1e-12)
    with pytest.raises(nc.AssemblyError, match="mirror"):
        nc.solve_position(still(), {}, start={"P": start["P"] * flip, "w": start["w"] * flip})


@pytest.mark.slow
def test_a_design_that_leaves_its_class():
    """A point drawn off its line, or off its plane: a status; along the line, or in the plane, it is a design."""
    for point, place, status in (
        ("K", (2.5, 0.01, 0.0), Status.LEFT_CLASS),
        ("L", (0.6, 0.7, -0.01), Status.LEFT_CLASS),
        ("K", (-1.5, 0.0, 0.0), Status.CONVERGED),
        ("L", (0.1, 0.9, 0.0), Status.CONVERGED),
        ("Q", (0.3, 0.4, 0.0), Status.CONVERGED),  # the exact form has no class
        ("Q", (0.3, 0.4, -0.8), Status.CONVERGED),
    ):
        changed = still().replace({point: place})
        found = pose(changed, **{name: changed[name] for name in "PQKLXYZwv"})
        assert Status(int(found.status)) is status, (point, place)
        if status is Status.CONVERGED:
            np.testing.assert_allclose(found[point], place, atol=1e-12)
    assert "compile the mechanism anew" in Status.LEFT_CLASS.sentence


@pytest.mark.slow
def test_explicit_lengths():
    """They win over the drawing, are design variables, and leave a triangle on its drawn side."""
    for more in ({}, {"bar.A-X": 3.0, "triangle.A-Y": 2.4, "triangle.Z-A": 1.5}):
        changed = still().replace(more)
        found = pose(changed, **{name: changed[name] for name in "PQKLXYZwv"})
        assert bool(found.converged)
        sides = [np.linalg.norm(found[b] - found[a]) for a, b in ("AX", "AY", "AZ", "YZ")]
        want = [more.get(n, d) for n, d in (("bar.A-X", 2.5), ("triangle.A-Y", 2.1), ("triangle.Z-A", 1.8), ("", 1.6))]
        np.testing.assert_allclose(sides, want, atol=1e-12)
        assert found["Z"][1] > 0


@pytest.mark.parametrize(
    ("points", "vectors", "form", "says"),
    [
        ([A, B, 2 * B - A + [0, 0, 1e-6]], [], "exact", ["nearly in one line", "exactly in line", "across"]),
        ([A, B], [B - A + [0, 0, 1e-3]], "exact", ["nearly in one line", "across"]),
        ([A], [U, U + 1e-4 * V], "exact", ["nearly in one line", "vector 'u0'", "vector 'u1'"]),
        ([A, B, C, B + C - A + [0, 0, 2e-4]], [], "text", ["nearly in one plane", "form='exact'"]),
        ([A, A, A], [], "exact", ["same place", "P0, P1, P2", "move one"]),
    ],
)
def test_nearly_degenerate_drawings_are_refused(points, vectors, form, says):
    m = nc.Mechanism("rig", dim=3)
    for i, at in enumerate(points):
        m.point(f"P{i}", at)
    for i, direction in enumerate(vectors):
        m.vector(f"u{i}", direction)
    m.body("rotor", [f"P{i}" for i in range(len(points))], vectors=[f"u{i}" for i in range(len(vectors))], form=form)
    with pytest.raises(nc.MechanismError) as caught:
        assemble(m)
    assert all(part in str(caught.value) for part in ("'rotor'", *says)), str(caught.value)


def test_lengths_that_no_triangle_has():
    for lengths, says in (
        ({("A", "B"): 1.0, ("B", "C"): 1.0, ("C", "A"): 2.5}, "triangle inequality"),
        (
            {("A", "B"): 1.0, ("B", "C"): 1.0, ("C", "D"): 1.0, ("A", "D"): 1.0, ("B", "D"): 1.0, ("A", "C"): 1.0},
            "two lengths",
        ),
    ):
        m = nc.Mechanism("rig", dim=3)
        for name, at in zip("ABCD", (A, B, C, D), strict=True):
            m.point(name, at)
        m.body("plate", list("ABCD"), lengths=lengths)
        with pytest.raises(nc.MechanismError, match=f"'plate'.*{says}"):
            assemble(m)
