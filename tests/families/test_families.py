"""Families of coordinates: counts and equations of the text's worked case, maps, every joint, dynamics by recursion."""

import functools
import json
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from coordinate_families import every_planar_joint, every_spatial_joint, worked

import jaxnc as nc
from jaxnc.cli import main
from jaxnc.constraints.symbols import Expression, Symbol
from jaxnc.errors import InputError
from jaxnc.families import Chain, accelerations, mass_matrix, simulate
from jaxnc.solvers.assembly import derive, sample_poses, to_host
from jaxnc.system.equations import residual

ROUNDING = 1e-12  # poses of size one, by maps of a few operations and solves to the last digits
RECURSION = 1e-10  # two ways to accelerations of size ten, each by an elimination

PSI = np.linspace(0.7, 0.7 + 2 * math.pi, 13)
SYMBOLS = {"L_A1": "L_1", "L_12": "L_2", "L_D3": "L_3"}


@functools.cache
def formulation(family: str) -> nc.families.Formulation:
    return nc.formulate(worked(), family)


def closed_form(psi: np.ndarray) -> np.ndarray:
    """Points 1, 2, 3 of the worked case, from the triangle 1-D-3 with its right angle at 3."""
    one = np.stack([np.cos(psi), np.sin(psi)], -1)
    d = np.array([3.0, 0.0]) - one
    reach = np.linalg.norm(d, axis=-1)
    turn = np.arctan2(d[:, 1], d[:, 0]) + np.arcsin(0.5 / reach)
    e = np.stack([np.cos(turn), np.sin(turn)], -1)
    return np.concatenate([one, one + 4.0 * e, one + np.sqrt(reach**2 - 0.25)[:, None] * e], axis=-1)


# -- the worked case ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("family", "n", "r"), [("relative", 3, 2), ("reference", 9, 8), ("natural", 6, 5), ("mixed", 9, 8)]
)
def test_counts_of_the_text(family, n, r):
    f = formulation(family)
    assert (f.n, f.r, f.g) == (n, r, 1)
    assert f.rows == r


def test_equations_as_the_text_prints_them():
    """(3)-(4), (5)-(12), (13)-(17); point A is not the origin here, so that L4 is x_D - x_A."""
    short = {name: SYMBOLS[name] for name in ("L_A1", "L_D3")}
    assert str(formulation("relative").equations(names=short)).splitlines() == [
        "L_1 cos ψ_1 + s cos(ψ_1 + ψ_2 - π) + L_3 sin(ψ_1 + ψ_2 - π) + x_A - x_D = 0",
        "L_1 sin ψ_1 + s sin(ψ_1 + ψ_2 - π) - L_3 cos(ψ_1 + ψ_2 - π) + y_A - y_D = 0",
    ]
    reference = formulation("reference").equations(names=SYMBOLS)
    assert set(str(reference).splitlines()) == {
        "x_1 - L_1/2 cos ψ_1 - x_A = 0",
        "y_1 - L_1/2 sin ψ_1 - y_A = 0",
        "x_1 + L_1/2 cos ψ_1 - x_2 + L_2/2 cos ψ_2 = 0",
        "y_1 + L_1/2 sin ψ_1 - y_2 + L_2/2 sin ψ_2 = 0",
        "ψ_3 - ψ_2 - π/2 = 0",
        "(x_2 - x_3) cos ψ_3 + (y_2 - y_3) sin ψ_3 - L_3/2 = 0",
        "x_3 - L_3/2 cos ψ_3 - x_D = 0",
        "y_3 - L_3/2 sin ψ_3 - y_D = 0",
    }
    assert str(formulation("natural").equations(names=SYMBOLS)).splitlines() == [
        "(x_1 - x_A)^2 + (y_1 - y_A)^2 - L_1^2 = 0",
        "(x_2 - x_1)^2 + (y_2 - y_1)^2 - L_2^2 = 0",
        "(x_3 - x_D)^2 + (y_3 - y_D)^2 - L_3^2 = 0",
        "(x_2 - x_1) (y_3 - y_1) - (y_2 - y_1) (x_3 - x_1) = 0",
        "(x_2 - x_1) (x_D - x_3) + (y_2 - y_1) (y_D - y_3) = 0",
    ]
    assert (reference.degree, reference.trigonometric) == (2, 10)
    assert formulation("relative").equations().trigonometric == 6
    assert (formulation("natural").equations().degree, formulation("natural").equations().trigonometric) == (2, 0)
    assert r"\frac{L_{1}}{2} \cos \psi_{1}" in reference.latex() and r"| $\psi_{3}" in reference.markdown()
    numbers = str(formulation("relative").equations(numbers=True)).splitlines()
    assert numbers[0] == "cos ψ_1 + s cos(ψ_1 + ψ_2 - π) + sin(ψ_1 + ψ_2 - π)/2 - 3 = 0"


def test_a_name_of_two_words_is_no_product():
    m = nc.Mechanism("rod")
    m.ground("O", (0, 0))
    m.point("P", (3, 4))
    m.body("tie rod", ["O", "P"])
    written = nc.formulate(m, "reference").equations(names={"L_OP": "my length"})
    assert str(written).splitlines()[0] == "x_tie_rod - my_length/2 cos ψ_tie_rod - x_O = 0"
    assert r"x_{\mathrm{tie~rod}} - \frac{\mathrm{my~length}}{2}" in written.latex()


def test_what_is_divided_stands_in_brackets_where_it_could_be_read_otherwise():
    phi, length = (Expression.of(Symbol(name, name, name == "φ")) for name in ("φ", "L"))
    co = phi.apply("cos")
    assert str(0.1 * co) == "(cos φ)/10" and str(co / length) == "(cos φ)/L" and str(3 * co) == "3 cos φ"
    assert str(0.5 * (phi + length).apply("cos") ** 2) == "cos^2(φ + L)/2" and str(0.5 * length * co) == "L/2 cos φ"
    assert str(0.5 * co / length) == "(cos φ)/2/L"
    assert str(0.5 * (phi + length).apply("cos") / length) == "cos(φ + L)/2/L"


@pytest.mark.parametrize("family", ["relative", "reference", "mixed"])
def test_what_is_written_is_what_is_solved(family):
    """Every written equation, evaluated, is the residual of its row: at a pose that meets none of them."""
    f = formulation(family)
    top, eq = f.topology, derive(f.system)
    rng = np.random.default_rng(7)
    q = np.asarray(eq.home).copy()
    q[top.unknown] += rng.normal(size=f.n)
    values = {"ψ" + n[3:] if n.startswith("psi") else n: q[top.position[n]] for n in top.scalars}
    shown = {line.split(".")[1] + "_" + line.split(".")[0]: line for line in top.coordinates if "." in line}
    values = {k.replace("ψ", "ψ_"): v for k, v in values.items()}
    values |= {k.replace("psi", "ψ"): q[top.position[v]] for k, v in shown.items() if top.position[v] in top.unknown}
    scale = np.concatenate([np.asarray(s).reshape(-1) for s in eq.scales])
    written = np.array([line.expression.evaluate(values) for line in f.equations()])
    np.testing.assert_allclose(written * scale, residual(eq, q), atol=ROUNDING)


def test_same_motion_in_every_family():
    f = formulation("relative")
    found = nc.sweep(f.system, {"psi1": PSI})
    assert found.converged.all()
    q = f.to_natural(found)
    np.testing.assert_allclose(q[:, 4:10], closed_form(PSI), atol=ROUNDING)
    assert np.abs(to_host(derive(f.natural)).residual(np.asarray(q).T)).max() < ROUNDING
    np.testing.assert_allclose(f.from_natural(q), found.q[:, f.topology.unknown], atol=ROUNDING)
    np.testing.assert_allclose(f.motion(found)["3"], closed_form(PSI)[:, 4:], atol=ROUNDING)
    # The poses meet the equations of the others too, and come back from their variables.
    for family in ("reference", "natural"):
        g = formulation(family)
        z, eq = g.from_natural(q), to_host(derive(g.system))
        whole = np.repeat(eq.home[:, None], len(z), axis=1)
        whole[g.topology.unknown] = np.asarray(z).T
        assert np.abs(eq.residual(whole)).max() < ROUNDING
        np.testing.assert_allclose(g.to_natural(z)[:, 4:10], closed_form(PSI), atol=ROUNDING)


def test_maps_are_differentiable():
    """There and back is the identity to first order, and a length of the drawing moves what hangs on it."""
    f = formulation("relative")
    z = f.from_natural(sample_poses(f.natural)[0].q)
    there, back = jax.jacfwd(f.to_natural)(z), jax.jacrev(f.from_natural)(f.to_natural(z))
    np.testing.assert_allclose(back @ there, np.eye(3), atol=1e-11)

    def height(system):
        return f.of(system).to_natural(z)[9]

    slope = jax.grad(height)(f.natural)["3"]
    step = 1e-6
    for axis in range(2):
        d = np.zeros(2)
        d[axis] = step
        up, down = (height(f.natural.replace({"3": f.natural["3"] + sign * d})) for sign in (1, -1))
        np.testing.assert_allclose(slope[axis], (up - down) / (2 * step), atol=1e-8)


# -- independent coordinates ------------------------------------------------------------------------------------------


def test_both_assemblies_of_the_four_bar():
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.3, 1.0))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["D", "C"])
    m.angle("alpha", at="A", to="B")
    f = nc.formulate(m, "independent")
    assert (f.n, f.r, f.g) == (1, 0, 1)
    found = f.assemblies({"alpha": 0.7})
    crank, coupler, rocker = math.hypot(0.3, 1.0), math.hypot(3.0, 1.9), math.hypot(0.7, 2.9)
    b = crank * np.array([math.cos(0.7), math.sin(0.7)])
    d = np.array([4.0, 0.0]) - b
    along = (coupler**2 - rocker**2 + d @ d) / (2 * d @ d)
    across = math.sqrt(coupler**2 / (d @ d) - along**2)
    both = [b + along * d + sign * across * np.array([-d[1], d[0]]) for sign in (1, -1)]
    np.testing.assert_allclose(found["C"], both, atol=1e-11)  # the drawing's first; Newton's last step
    np.testing.assert_allclose(f.to_natural([[0.7]])[0, 6:8], both[0], atol=ROUNDING)
    with pytest.raises(InputError, match=r"a value of each of alpha; got beta"):
        f.assemblies({"beta": 0.7})
    with pytest.raises(InputError, match="family='relative'"):
        mass_matrix(f, [0.7])


def robot(masses: bool = False) -> nc.Mechanism:
    def mass(**what):
        return what if masses else {}

    m = nc.Mechanism("planar 3-R robot")
    m.ground("O", (0, 0))
    m.point("A", (1.0, 0.5))
    m.point("B", (1.9, 0.9))
    m.point("P", (2.5, 1.5))
    m.body("1", ["O", "A"], **mass(mass=1.2, inertia=0.3, com=(0.4, 0.3)))
    m.body("2", ["A", "B"], **mass(mass=0.7, shape="rod"))
    m.body("3", ["B", "P"], **mass(mass=0.5, inertia=0.1, com=(2.2, 1.3)))
    m.angle("alpha", at="O", to="A")
    m.angle("beta", to=("A", "B"), start=("O", "A"))
    m.angle("gamma", to=("B", "P"), start=("A", "B"))
    if masses:
        m.gravity = (0.0, -9.81)
    else:
        m.angle("psi", to=("B", "P"))
    return m


def test_robot_directly_and_by_its_hand():
    direct = nc.formulate(robot(True), "independent")
    assert (direct.n, direct.r, list(direct.variables)) == (3, 0, ["alpha", "beta", "gamma"])
    turns, lengths = np.cumsum([0.1, 0.2, 0.3]), [math.hypot(1, 0.5), math.hypot(0.9, 0.4), math.hypot(0.6, 0.6)]
    joints = np.cumsum([size * np.array([math.cos(t), math.sin(t)]) for size, t in zip(lengths, turns, strict=True)], 0)
    np.testing.assert_allclose(direct.to_natural([0.1, 0.2, 0.3])[2:8], joints.reshape(-1), atol=ROUNDING)

    hand = nc.formulate(robot(), "independent", keep=["P.x", "P.y", "psi"])
    found = hand.assemblies({"P.x": 2.0, "P.y": 1.0, "psi": 0.5})
    wrist = np.array([2.0, 1.0]) - lengths[2] * np.array([math.cos(0.5), math.sin(0.5)])
    reach = math.hypot(*wrist)
    elbow = math.acos((lengths[0] ** 2 + reach**2 - lengths[1] ** 2) / (2 * lengths[0] * reach))
    turn = math.atan2(wrist[1], wrist[0])
    np.testing.assert_allclose(sorted(np.asarray(found["alpha"])), [turn - elbow, turn + elbow], atol=1e-11)
    np.testing.assert_allclose(found["P"], [[2.0, 1.0]] * 2, atol=1e-11)


# -- reference points ---------------------------------------------------------------------------------------------


def test_the_reference_point_is_the_centre_of_mass_unless_another_is_chosen():
    """About the centre of mass (x, y, ψ) have the mass matrix diag(m, m, I); about any other point they have not."""
    m = nc.Mechanism("free rod")
    m.point("O", (0, 0))
    m.point("A", (1.0, 0.5))
    m.body("rod", ["O", "A"], mass=1.2, inertia=0.3, com=(0.4, 0.3))
    m.marker("G", on="rod", at=(0.4, 0.3))
    m.marker("E", on="rod", at=(0.1, 0.7))
    pose = np.array([0.0, 0.0, 1.0, 0.5])
    for reference, place in (("mass", (0.4, 0.3)), ("middle", (0.5, 0.25)), ({"rod": "E"}, (0.1, 0.7))):
        f = nc.formulate(m, "reference", reference=reference)
        z = f.from_natural(pose)
        np.testing.assert_allclose(z[:2], place, atol=ROUNDING)
        np.testing.assert_allclose(f.to_natural(z), pose, atol=ROUNDING)
        assert (f.n, f.rows, f.g) == (3, 0, 3)
        off = np.array([0.4, 0.3]) - place
        inertia = 0.3 + 1.2 * off @ off
        want = [[1.2, 0, -1.2 * off[1]], [0, 1.2, 1.2 * off[0]], [-1.2 * off[1], 1.2 * off[0], inertia]]
        np.testing.assert_allclose(mass_matrix(f, z), want, atol=ROUNDING)
    with pytest.raises(InputError, match="reference='centre'; use 'mass', 'middle'"):
        nc.formulate(m, "reference", reference="centre")
    with pytest.raises(InputError, match=r"no moving body has that name.*rod"):
        nc.formulate(m, "reference", reference={"rot": "A"})
    with pytest.raises(InputError, match="body 'rod' has no such point"):
        nc.formulate(m, "reference", reference={"rod": "X"})


def test_any_point_of_every_body_is_a_reference_point():
    """The worked case (the prismatic joint too) and the RSCR, by points and by places beside their bodies."""
    f = fits(worked(), "reference", reference={"1": "A", "2": (2.0, 1.0), "3": (1.0, -0.4)})
    assert (f.n, f.rows, f.r, f.g) == (9, 8, 8, 1)
    np.testing.assert_allclose(f.from_natural(sample_poses(f.natural)[0].q)[:2], (0, 0), atol=ROUNDING)
    space = {"crank": "1", "coupler": (0.2, -0.1, 0.3), "rocker": (0.0, 0.1, 0.0)}
    fits(nc.library.rscr(), "reference", reference=space)


# -- relative coordinates of a loop in space --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("orientation", "closed", "n", "rows"),
    [
        ("bryant angles", "body", 7, 6),  # the paper's: 1 + 3 + 2 + 1 joint variables, six equations
        ("euler angles", "body", 7, 6),
        ("bryant angles", "joint", 4, 3),
    ],
)
def test_the_rscr_in_the_papers_relative_coordinates(orientation, closed, n, rows):
    m = nc.library.rscr(crank_angle=True)
    f = fits(m, "relative", orientation=orientation, closed=closed)
    assert (f.n, f.rows, f.r, f.g) == (n, rows, rows, 1)
    if (orientation, closed) != ("bryant angles", "body"):
        return
    turn = {"phi": np.linspace(0.1, 1.3, 7)}
    found, natural = nc.sweep(f.system, turn), nc.sweep(f.natural, turn)
    assert found.converged.all() and natural.converged.all()
    np.testing.assert_allclose(f.to_natural(found), natural.q, atol=ROUNDING)
    np.testing.assert_allclose(f.from_natural(natural.q), found.q[:, f.topology.unknown], atol=ROUNDING)


def test_a_ball_joint_of_an_open_chain_has_three_angles():
    """Three angles need no equation; a pendulum of two rods on a ball joint is then free of equations altogether."""
    m = nc.Mechanism("pendulum", dim=3)
    m.ground("O", (0, 0, 0))
    m.point("A", (0.3, 0.1, -1.0))
    m.vector("u", (1, 0, 0))
    m.body("rod", ["O", "A"], vectors=["u"])
    for orientation, n, rows in (("bryant angles", 3, 0), ("euler angles", 3, 0), ("euler parameters", 4, 1)):
        f = nc.formulate(m, "relative", orientation=orientation)
        assert (f.n, f.rows, f.g) == (n, rows, 3)
    bryant = nc.formulate(m, "relative", orientation="bryant angles")
    roll, pitch, yaw = 0.3, -0.4, 0.9
    x, y, z = (
        np.array([[1, 0, 0], [0, math.cos(roll), -math.sin(roll)], [0, math.sin(roll), math.cos(roll)]]),
        np.array([[math.cos(pitch), 0, math.sin(pitch)], [0, 1, 0], [-math.sin(pitch), 0, math.cos(pitch)]]),
        np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]),
    )
    q = bryant.to_natural([roll, pitch, yaw])
    np.testing.assert_allclose(q[3:6], x @ y @ z @ [0.3, 0.1, -1.0], atol=ROUNDING)


def test_a_loop_that_cannot_be_closed_through_a_body_is_refused():
    with pytest.raises(InputError, match="closed='bodies'; use 'joint' or 'body'"):
        nc.formulate(worked(), "relative", closed="bodies")
    with pytest.raises(InputError, match="relative coordinates in space"):
        nc.formulate(worked(), "relative", closed="body")


# -- every joint in every family --------------------------------------------------------------------------------------

PLANE = ("O", "hinge", "slot", "guide", "gears", "rolling", "Y")
SPACE = ("O", "cylinder", "guide", "cross", "E", "gears", "thread")
REFUSED = {
    "gears": "the gear pair 'gears' is an equation between alpha and beta",
    "thread": "the screw joint 'thread' is an equation between turn and rise",
    "rolling": "the rolling joint 'rolling' is an equation between spin and way",
}


def fits(m: nc.Mechanism, family: str, **options) -> nc.families.Formulation:
    """As many freedoms as in natural coordinates, and their poses, here and a little further, are poses here."""
    f = nc.formulate(m, family, **options)
    assert f.g == f.natural.degrees_of_freedom
    eq = to_host(derive(f.system))
    for sample in sample_poses(f.natural):
        z, whole = f.from_natural(sample.q), np.array(eq.home)
        whole[f.topology.unknown] = z
        assert np.abs(eq.residual(whole[:, None])).max() < ROUNDING
        np.testing.assert_allclose(f.to_natural(z), sample.q, atol=ROUNDING)
    return f


@pytest.mark.parametrize("family", ["relative", "reference"])
def test_markers_are_no_part_of_a_family(family):
    fits(nc.library.spherical_four_bar(), family)


def test_a_bar_that_hangs_free_has_its_direction():
    """The tie rod of a suspension hangs on a ball joint, and closes a loop by the rack that it slides on."""
    f = nc.formulate(nc.library.double_wishbone(), "relative")
    assert f.g == f.natural.degrees_of_freedom == 3 and "tie rod.ux" in f.variables
    for sample in sample_poses(f.natural):
        np.testing.assert_allclose(f.to_natural(f.from_natural(sample.q)), sample.q, atol=1e3 * ROUNDING)  # mm


def expressed(f: nc.families.Formulation, joint: str) -> bool:
    """Whether a joint has a variable or a row of its own."""
    rows = any(row.startswith((f"{joint}:", f"{joint} and ")) for row in f.topology.rows)
    return rows or any(f" at {joint}" in what or f" in {joint} " in what for what in f.variables.values())


@pytest.mark.parametrize("family", ["relative", "reference"])
def test_every_joint_in_the_plane(family):
    f = fits(every_planar_joint(), family)
    met = {"Y"} if family == "relative" else set()  # a coordinate that is fixed leaves the variable Y.x alone
    assert [j for j in PLANE if not expressed(f, j) and j not in met] == []
    assert "Y.x" in f.variables or family == "reference"


def test_a_slot_between_parts_that_share_unit_vectors_is_a_slide_or_a_cylinder():
    """Mass matrices by hand: the mass, and the moment about the axis."""
    for vectors, want in (("uv", [2.0]), ("u", [2.0, 0.3 + 2.0 * 0.4**2])):
        m = nc.Mechanism("slide", dim=3)
        m.ground("P", (0, 0, 0))
        m.ground_vector("u", (0, 0, 1))
        m.ground_vector("v", (1, 0, 0))
        m.point("Q", (0, 0, 0.2))
        m.point("R", (0.1, 0, 0.2))
        m.body("s", ["Q", "R"], vectors=list(vectors), mass=2.0, com=(0.4, 0, 0.2), inertia=np.diag([0.1, 0.2, 0.3]))
        m.slot("groove", "Q", ("P", "u"))
        chain = Chain(m)
        assert (chain.formulation.n, chain.formulation.r) == (len(want), 0)
        np.testing.assert_allclose(np.sort(np.linalg.eigvalsh(chain.mass_matrix(np.zeros(len(want)))))[::-1],
                                   np.sort(want)[::-1], atol=ROUNDING)  # fmt: skip


def test_every_joint_in_space_relatively():
    f = fits(every_spatial_joint(), "relative")
    # Wheels on the ground are met by the angles that the user gave them, the screw's turn by its advance.
    assert [j for j in SPACE if not expressed(f, j)] == []
    assert {"alpha", "beta", "turn", "rise"} <= set(f.variables)


def test_every_joint_in_space_by_reference_points():
    f = fits(every_spatial_joint(), "reference")
    assert [j for j in SPACE if not expressed(f, j)] == []


@pytest.mark.parametrize("family", ["relative", "reference"])
def test_slot_and_rolling_in_space(family):
    m = nc.Mechanism("slot and rolling in space", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground("G", (1.0, -0.4, 0.1))
    m.ground_vector("k", (0, 0, 1))
    m.ground_vector("w", (0, 1, 0))
    m.ground_vector("i", (1, 0, 0))
    m.point("A", (1.5, 0.6, 0.1))
    m.point("P", (1.0, 0.4, 0.0667))
    m.body("slotted arm", ["O", "A"], vectors=["k"])
    m.body("pin", ["G", "P"], vectors=["k"])
    m.slot("slide", "P", ("O", "A"))
    m.point("H", (0.5, 0.0, 0.2))
    m.point("R", (0.62, 0.0, 0.29))
    m.point("T", (0.5, 0.0, 0.0))
    m.body("disc", ["H", "R"], vectors=["w"])
    m.rolling("roll", "H", "R", "T", ("O", "i"), "spin", "way", axis="w")
    f = fits(m, family)
    assert expressed(f, "slide") and expressed(f, "roll")


@pytest.mark.parametrize("orientation", ["euler angles", "bryant angles", "rotation matrix"])
def test_orientation_by_other_parameters(orientation):
    m = nc.Mechanism("door", dim=3)
    m.ground("O", (0, 0, 0))
    m.ground_vector("k", (0.1, 0.2, 1))
    m.point("A", (0.1, 0.9, 0.8))
    m.body("door", ["O", "A"], vectors=["k"])
    f = fits(m, "reference", orientation=orientation)
    assert (f.n, f.r, f.g) == {"rotation matrix": (12, 11, 1)}.get(orientation, (6, 5, 1))


@pytest.mark.parametrize("joint", list(REFUSED))
def test_natural_coordinates_refuse_by_name(joint):
    m = every_spatial_joint() if joint == "thread" else every_planar_joint()
    for other in (REFUSED.keys() & m.model.joints.keys()) - {joint}:
        del m.model.joints[other]
    with pytest.raises(InputError, match=REFUSED[joint]) as refused:
        nc.formulate(m, "natural")
    assert "use family='mixed'" in str(refused.value)


def test_wrong_questions_are_answered_by_name():
    m = worked()
    for what, message in (
        ({"family": "natrual"}, "family='natrual'; did you mean 'natural'"),
        ({"family": "relative", "keep": ["phi"]}, "no angle, distance or moving point of that name"),
        ({"family": "reference", "orientation": "quaternion"}, "orientation='quaternion'"),
        ({"family": "independent", "keep": ["psi1", "s"]}, "1 degrees of freedom; name as many"),
    ):
        with pytest.raises(InputError) as refused:
            nc.formulate(m, **what)
        assert message in str(refused.value)
    with pytest.raises(InputError, match="takes the Mechanism, got System"):
        nc.formulate(formulation("relative").natural, "relative")
    with pytest.raises(InputError, match=r"names=.*'L_9'.*no such symbol"):
        formulation("relative").equations(names={"L_9": "L"})
    with pytest.raises(InputError, match=r"variables.*\(\.\.\., 3\).*\(2,\)"):
        formulation("relative").to_natural(np.zeros(2))
    with pytest.raises(InputError, match="recursion is for open chains"):
        Chain(m)


# -- dynamics ---------------------------------------------------------------------------------------------------------


def arm_in_space() -> nc.Mechanism:
    """An open chain with a hinge, a cylindrical and a universal joint."""
    m = nc.Mechanism("chain in space", dim=3)
    m.gravity = (0.3, -0.2, -9.81)
    m.ground("O", (0, 0, 0))
    m.ground_vector("k", (0, 0, 1))
    for name, at in {"A": (0.1, 0.2, 0.8), "C": (0.6, 0.35, 0.9), "E": (0.9, 1.0, 1.4)}.items():
        m.point(name, at)
    for name, d in {"u": (1.0, 0.3, 0.2), "w": (0.1, 0.85, 0.2), "y": (0.3, 0.1, 1.0), "x": (1, 0, 0.1)}.items():
        m.vector(name, d)
    full = (0.3, 0.2, 0.4, 0.01, 0.02, -0.03)
    m.body("1", ["O", "A"], vectors=["k", "u"], mass=2.0, com=(0.1, 0.1, 0.4), inertia=full)
    m.body("2", ["C"], vectors=["u", "w"], mass=1.0, com=(0.5, 0.4, 0.9), inertia=(0.1, 0.2, 0.15, 0.01, 0.0, 0.02))
    m.body("3", ["C", "E"], vectors=["y", "x"], mass=0.6, com=(0.7, 0.7, 1.2), inertia=(0.05, 0.06, 0.07))
    m.cylindrical("cylinder", line=("A", "u"), on="C")
    m.universal("cross", axes=("w", "y"))
    return m


@pytest.mark.parametrize("make", [lambda: robot(True), arm_in_space], ids=["plane", "space"])
def test_recursion_agrees_with_natural_coordinates(make):
    chain = Chain(make())
    f = chain.formulation
    rng = np.random.default_rng(3)
    z, dz = np.asarray(chain.home) + 0.4 * rng.normal(size=f.n), rng.normal(size=f.n)
    if f.natural.topology.dim == 2:  # in space the accelerations have it in them, and that is enough to compile
        np.testing.assert_allclose(chain.mass_matrix(z), mass_matrix(f, z), atol=ROUNDING)
    found = accelerations(f, z, dz)
    np.testing.assert_allclose(chain.accelerations(z, dz), found, atol=RECURSION)
    np.testing.assert_allclose(chain.efforts(z, dz, found), 0.0, atol=RECURSION)
    assert np.abs(np.asarray(found)).max() > 1.0


def test_same_simulation_in_two_families():
    m = nc.Mechanism("falling four-bar")
    m.gravity = (0.0, -9.81)
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.3, 1.0))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"], mass=1.0)
    m.body("coupler", ["B", "C"], mass=2.0)
    m.body("rocker", ["D", "C"], mass=1.5)
    m.angle("alpha", at="A", to="B")
    t = np.array([0.0, 0.1, 0.2])
    runs = {family: simulate(nc.formulate(m, family), t, step=2e-3) for family in ("relative", "natural")}
    one, other = runs.values()
    assert np.abs(np.asarray(other.velocity("C"))[-1]).max() > 0.1
    np.testing.assert_allclose(one.q, other.q, atol=1e-9)  # both by steps of fourth order
    np.testing.assert_allclose(one.acceleration("C"), other.acceleration("C"), atol=1e-7)
    energy = nc.dynamics.kinetic_energy(one) + nc.dynamics.potential_energy(one)
    np.testing.assert_allclose(energy - energy[0], 0.0, atol=1e-8)


# -- the command ------------------------------------------------------------------------------------------------------


def test_compare_says_and_writes(tmp_path, capsys):
    m = worked(False)
    m.model.description = "Crank, bar and arm."
    path = m.save(tmp_path / "worked.toml")
    out = tmp_path / "out"
    families = "independent,relative"
    assert main(["compare", str(path), "--families", families, "--out", str(out), "--no-cache"]) == 0
    said, err = capsys.readouterr()
    assert err == ""
    cells = {line.split()[0]: line.split()[1:4] for line in said.splitlines() if line.startswith(("indep", "relat"))}
    assert cells == {"independent": ["1", "0", "1"], "relative": ["3", "2", "1"]}
    whole = json.loads((out / "coordinate-comparison-families.json").read_text(encoding="utf-8"))
    row = whole["families"][1]
    assert row["iterations"] <= 6 and row["condition"] > 1.0 and row["microseconds"] > 0.0
    assert (row["rows"], row["nonzeros"], row["degree"]) == (2, 6, 2)
    assert row["basin"][0] == 1.0 and row["basin"][-1] < 1.0  # near starts come home, far ones do not all
    equations = (out / "coordinate-comparison-equations.md").read_text(encoding="utf-8")
    assert "## relative: n = 3, r = 2, g = 1" in equations
    picture = (out / "coordinate-comparison-families.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert main(["compare", str(path), "--families", "absolute", "--no-cache"]) == 2
    assert "no family 'absolute'" in capsys.readouterr().err


def test_a_mass_of_a_body_with_two_directions_has_its_centre():
    """A crank of two points and one vector has a third direction in its inertia, which its coordinates have not."""
    m = nc.Mechanism("arm", dim=3)
    m.ground("A", (0, 0, 0)), m.ground_vector("v", (0, 0, 1)), m.point("B", (1, 0, 0))
    m.body("arm", ["A", "B"], vectors=["v"], mass=1.0, com=(0.3, 0.1, 0.1), inertia=np.eye(3))
    places = nc.formulate(m, "reference").variables
    assert len(places) == nc.formulate(m, "reference", reference="middle").n > 0


def test_what_failed_stands_still_in_every_family():
    """Beyond the reach of a crank, which is a dead point of the rocker."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0.6, 0.8))
    m.point("C", (3.3, 2.9))
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C"])
    m.body("rocker", ["C", "D"])
    m.angle("psi", at="D", to="C")
    f, natural = nc.formulate(m, "relative", keep=["psi"]), m.compile()
    driven = {"psi": np.arctan2(2.9, -0.7) + np.array([0.0, 2.0])}

    def last(design):
        own = f.of(design)
        return own.motion(nc.sweep(own.system, driven, throw=False))["C"][-1].sum()

    assert np.asarray(nc.sweep(f.system, driven, throw=False).status)[-1] != 0
    assert np.all(np.asarray(jax.grad(last)(natural)["C"]) == 0.0)


def test_simulations_in_families_are_differentiated():
    """A pendulum by its angle: traced, and against finite differences."""
    m = nc.Mechanism("pendulum")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.body("rod", ["A", "B"], mass=1.0)
    m.angle("phi", "A", "B")
    m.gravity = (0, -9.81)
    f, system, t = nc.formulate(m, "relative"), m.compile(), np.linspace(0, 0.1, 3)

    def height(length):
        return simulate(f.of(system.replace({"B": jnp.stack([length, 0.0 * length])})), t, step=1e-2)["B"][-1, 1]

    slope = (float(height(1.001)) - float(height(0.999))) / 0.002
    assert float(jax.grad(height)(1.0)) == pytest.approx(slope, rel=1e-4)
    assert float(jax.jit(height)(1.0)) == pytest.approx(float(height(1.0)), rel=1e-12)


def test_a_spring_winds_a_rotor_in_space_by_more_than_a_turn():
    """Against the harmonic swing; reference points alone tell the angle but for whole turns."""
    m = nc.Mechanism("rotor", dim=3)
    for name, at in (("A", (0, 0, 0)), ("G", (1, 0, 0))):
        m.ground(name, at)
    m.ground_vector("u", (0, 0, 1))
    m.point("P", (1, 0, 0))
    m.body("r", ["A", "P"], vectors=["u"], mass=1.0, com=(0.3, 0, 0), inertia=np.diag([0.1, 0.1, 0.2]))
    m.angle("phi", at="A", start="G", to="P", about="u")
    m.spring("k", "phi", stiffness=2.0, free=6.0)
    t = np.linspace(0.0, 2.0, 11)
    kept = nc.formulate(m, "reference", keep=["phi"])
    wanted = 6.0 - 6.0 * np.cos(np.sqrt(2.0 / (0.2 + 0.3**2)) * t)
    np.testing.assert_allclose(nc.families.simulate(kept, t)["phi"], wanted, atol=1e-6)
    with pytest.raises(nc.InputError, match=r"the angle 'phi'.*keep=\['phi'\]"):
        nc.families.simulate(nc.formulate(m, "reference"), t)
