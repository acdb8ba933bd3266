"""Every form of every constraint moves the same mechanism the same way, and says so when it cannot."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxnc as nc

TURN = np.linspace(0.05, 0.05 + 2 * np.pi, 61)


def crank_and_rocker(angle_form="exact", body_form="exact", aligned=False):
    m = nc.Mechanism("four-bar")
    A, D = m.ground("A", (0, 0)), m.ground("D", (4, 0))
    B, C = m.point("B", (0.5, 0.9)), m.point("C", (3.3, 2.9))
    P = m.point("P", (1.9, 1.9) if aligned else (1.8, 2.6))
    Q = m.point("Q", (2.46, 2.3) if aligned else (2.4, 3.0))
    m.body("crank", [A, B])
    m.body("coupler", [B, C, P, Q], form=body_form)
    m.body("rocker", [C, D])
    m.angle("phi", at=A, to=B, form=angle_form)
    m.angle("psi", at=D, to=C, start=A, form=angle_form)
    return m.compile()


@pytest.fixture(scope="module")
def exact():
    return nc.sweep(crank_and_rocker(), {"phi": TURN})


@pytest.mark.parametrize("form", ["redundant", "switched"])
def test_angle_policies_that_hold_over_a_full_turn(form, exact):
    mo = nc.sweep(crank_and_rocker(form), {"phi": TURN})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["P"], exact["P"], atol=1e-12)
    np.testing.assert_allclose(mo["psi"], exact["psi"], atol=1e-12)


@pytest.mark.parametrize(
    ("form", "u"),
    [
        ("cosine", np.linspace(0.3, 2.8, 21)),
        ("sine", np.linspace(-1.2, 1.2, 21)),
        ("sum", np.linspace(1.0, 3.6, 21)),
        ("difference", np.linspace(-0.6, 2.2, 21)),
    ],
)
def test_angle_policies_where_they_are_valid(form, u):
    """A crank alone: the cosine form is blind at 0 and π, the sine form at ±π/2, sum and difference at two angles."""
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    middle = float(np.mean(u))
    m.point("B", (2 * np.cos(middle), 2 * np.sin(middle)))
    m.body("crank", ["A", "B"])
    m.angle("phi", at="A", to="B", form=form)
    mo = nc.sweep(m.compile(), {"phi": u})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["B"], 2 * np.stack([np.cos(u), np.sin(u)], -1), atol=1e-12)


def test_blind_angle_form_stops_instead_of_lying():
    """Through φ = 0 the cosine form is singular: whatever is reported as converged must be the right pose."""
    m = nc.Mechanism("crank")
    m.ground("A", (0, 0))
    m.point("B", (2 * np.cos(1.0), 2 * np.sin(1.0)))
    m.body("crank", ["A", "B"])
    m.angle("phi", at="A", to="B", form="cosine")
    u = np.linspace(1.0, -1.0, 41)
    mo = nc.sweep(m.compile(), {"phi": u})
    good = np.asarray(mo.converged)
    assert good[:15].all() and not good.all()
    want = 2 * np.stack([np.cos(u), np.sin(u)], -1)
    np.testing.assert_allclose(np.asarray(mo["B"])[good], want[good], atol=1e-9)


@pytest.mark.parametrize("aligned", [False, True])
def test_body_forms(aligned):
    a = nc.sweep(crank_and_rocker(aligned=aligned), {"phi": TURN})
    b = nc.sweep(crank_and_rocker(body_form="text", aligned=aligned), {"phi": TURN})
    assert bool(jnp.all(a.converged & b.converged))
    assert len(a.system.topology.rows) == len(b.system.topology.rows)
    for name in "PQC":
        np.testing.assert_allclose(a[name], b[name], atol=1e-11)


def test_many_turns_are_counted():
    u = np.linspace(0.0, 6 * np.pi, 241)
    mo = nc.sweep(crank_and_rocker(), {"phi": u}, rates={"phi": 1.0})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["phi"], u, atol=1e-13)
    np.testing.assert_allclose(mo["P"][0], mo["P"][80], atol=1e-12)
    back = nc.sweep(crank_and_rocker(), {"phi": u[::-1]})
    np.testing.assert_allclose(back["P"][::-1], mo["P"], atol=1e-12)


def slide(form="exact", tilt=0.3):
    """A slider on a turning line: the distance from the pivot along it."""
    m = nc.Mechanism("slotted arm")
    m.ground("A", (0, 0))
    m.point("L", (3 * np.cos(tilt), 3 * np.sin(tilt)))
    m.point("S", (1.2 * np.cos(tilt), 1.2 * np.sin(tilt)))
    m.body("arm", ["A", "L"])
    m.slot("slot", "S", ("A", "L"))
    m.angle("phi", at="A", to="L")
    m.distance("s", "A", "S", along="L", form=form)
    return m.compile()


@pytest.mark.parametrize("form", ["exact", "redundant", "switched"])
def test_signed_distance_at_every_inclination_and_through_zero(form):
    phi = np.linspace(0.3, 0.3 + 2 * np.pi, 61)
    s = np.linspace(1.2, -2.0, 61)
    mo = nc.sweep(slide(form), {"phi": phi, "s": s}, rates={"phi": 1.0, "s": 0.5})
    assert bool(jnp.all(mo.converged))
    e = np.stack([np.cos(phi), np.sin(phi)], -1)
    n = np.stack([-np.sin(phi), np.cos(phi)], -1)
    np.testing.assert_allclose(mo["S"], s[:, None] * e, atol=1e-12)
    np.testing.assert_allclose(mo.velocity("S"), 0.5 * e + s[:, None] * n, atol=1e-11)
    # Coriolis: 2 s' φ' n - s φ'² e
    np.testing.assert_allclose(mo.acceleration("S"), n - s[:, None] * e, atol=1e-10)


@pytest.mark.parametrize(
    ("form", "lo", "hi"), [("x", -1.0, 1.0), ("y", 0.6, 2.4), ("sum", -0.6, 1.2), ("difference", 1.0, 3.4)]
)
def test_signed_distance_forms_where_they_are_valid(form, lo, hi):
    phi = np.linspace(lo, hi, 21)
    mo = nc.sweep(slide(form, tilt=float(np.mean(phi))), {"phi": phi, "s": np.full(21, -0.7)})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["S"], -0.7 * np.stack([np.cos(phi), np.sin(phi)], -1), atol=1e-11)


@pytest.mark.parametrize("form", ["exact", "text"])
def test_prismatic_joint_keeps_its_rank_when_directions_are_parallel(form):
    """A block that slides along a bar with its own line parallel to it: the text's (36) loses rank there."""
    m = nc.Mechanism("telescope")
    m.ground("A", (0, 0))
    m.point("B", (2, 1))
    m.point("C", (3, 1.5))
    m.point("D", (4, 2))
    m.body("tube", ["A", "B"])
    m.body("rod", ["C", "D"])
    m.prismatic("slide", line=("A", "B"), on=("C", "D"), form=form)
    m.angle("phi", at="A", to="B")
    m.distance("s", "A", "C", along="B")
    report = nc.mobility(m.compile())
    assert report.rows == 6
    if form == "exact":
        assert (report.n, report.rank, report.dof) == (8, 6, 2)
        phi, s = np.linspace(0.4, 6.6, 41), np.linspace(2.5, 5.0, 41)
        mo = nc.sweep(m.compile(), {"phi": phi, "s": s})
        assert bool(jnp.all(mo.converged))
        reach = s + np.hypot(1, 0.5)
        np.testing.assert_allclose(mo["D"], reach[:, None] * np.stack([np.cos(phi), np.sin(phi)], -1), atol=1e-11)
    else:
        assert report.rank == 5 and "slide: scalar product A-B-C-D" in report.redundant


def test_unshared_revolute_equals_shared():
    def build(shared):
        m = nc.Mechanism("bars")
        m.ground("A", (0, 0))
        m.ground("D", (4, 0))
        m.point("B", (0.5, 0.9))
        m.point("C", (3.3, 2.9))
        m.body("crank", ["A", "B"])
        if shared:
            m.body("coupler", ["B", "C"])
        else:
            m.point("B2", (0.5, 0.9))
            m.body("coupler", ["B2", "C"])
            m.revolute("pin", "B", "B2")
        m.body("rocker", ["C", "D"])
        m.angle("phi", at="A", to="B")
        return m.compile()

    a, b = nc.sweep(build(True), {"phi": TURN}), nc.sweep(build(False), {"phi": TURN})
    np.testing.assert_allclose(a["C"], b["C"], atol=1e-12)
    assert nc.mobility(b.system).grubler == nc.mobility(a.system).grubler == 1


@pytest.mark.parametrize("form", ["exact", "text"])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_rolling_on_a_tilted_fixed_line(form, side):
    """Closed form: the centre moves R dθ along the line; the sign follows from the side the disc is drawn on."""
    R, tilt = 0.8, 0.5
    e, n = np.array([np.cos(tilt), np.sin(tilt)]), np.array([-np.sin(tilt), np.cos(tilt)])
    m = nc.Mechanism("disc")
    A = np.array([0.3, -0.2])
    contact, centre = A + 1.5 * e, A + 1.5 * e + side * R * n
    m.ground("A", A)
    m.ground("B", A + 4 * e)
    m.point("M", centre)
    m.point("K", contact)
    m.point("Q", centre + R * np.array([np.cos(0.7), np.sin(0.7)]))
    m.body("disc", ["M", "Q"])
    m.rolling("roll", centre="M", rim="Q", contact="K", line=("A", "B"), angle="phi", distance="s", form=form)
    system = m.compile()
    assert nc.mobility(system).dof == 1 and len(system.topology.rows) == 7 and len(system.topology.unknown) == 8
    # More than a turn, past the start of the line; the text's (58) has its grip between 0 and half a turn.
    s = np.linspace(1.5, -6.0, 101) if form == "exact" else np.linspace(0.7, 2.3, 101)
    mo = nc.sweep(system, {"s": s}, rates={"s": 1.0})
    assert bool(jnp.all(mo.converged))
    theta = 0.7 - side * (s - 1.5) / R
    want = A + s[:, None] * e + side * R * n + R * np.stack([np.cos(theta), np.sin(theta)], -1)
    np.testing.assert_allclose(mo["Q"], want, atol=1e-11)
    np.testing.assert_allclose(mo.velocity("M"), np.broadcast_to(e, (101, 2)), atol=1e-11)
    if form == "exact":  # at the instant when the rim point is the contact point it stands still
        assert np.min(np.linalg.norm(np.asarray(mo.velocity("Q")), axis=1)) < 0.1


@pytest.mark.parametrize("internal", [False, True])
def test_gears_turn_by_their_ratio_over_several_turns(internal):
    m = nc.Mechanism("gears")
    m.ground("A", (0, 0))
    m.ground("B", (1.0, 0) if internal else (3.0, 0))
    m.point("P", (2.0 * np.cos(0.4), 2.0 * np.sin(0.4)))
    m.point("Q", (m.model.ground["B"][0] + np.cos(1.1), np.sin(1.1)))
    m.body("wheel", ["A", "P"])
    m.body("pinion", ["B", "Q"])
    m.angle("phi", at="A", to="P", start="B")
    m.angle("psi", at="B", to="Q")
    m.gear("mesh", "phi", "psi", internal=internal)
    u = np.linspace(0.4, 0.4 + 8 * np.pi, 161)
    mo = nc.sweep(m.compile(), {"phi": u}, rates={"phi": 1.0})
    assert bool(jnp.all(mo.converged))
    ratio = 2.0 if internal else -2.0
    np.testing.assert_allclose(mo["psi"], 1.1 + ratio * (u - 0.4), atol=1e-11)
    np.testing.assert_allclose(mo.velocity("psi"), ratio, atol=1e-12)


def test_cable_keeps_its_length():
    m = nc.Mechanism("hoist")
    m.ground("A", (0, 3))
    m.ground("B", (2, 3))
    m.point("L", (1, 1))
    m.point("H", (3, 0), fixed="x")
    m.cable("rope", ["A", "L", "B", "H"])
    m.relation("tie", {"L.x": 1.0}, constant=1.0)
    system = m.compile()
    assert nc.mobility(system).dof == 1
    y = np.linspace(0.0, 1.5, 21)
    mo = nc.sweep(system, {"H.y": y})
    assert bool(jnp.all(mo.converged))
    L, H = np.asarray(mo["L"]), np.asarray(mo["H"])
    parts = np.hypot(L[:, 0], L[:, 1] - 3) + np.hypot(L[:, 0] - 2, L[:, 1] - 3) + np.hypot(H[:, 0] - 2, H[:, 1] - 3)
    np.testing.assert_allclose(parts, 2 * np.hypot(1, 2) + np.hypot(1, 3), atol=1e-12)


def test_relation_between_angles_and_coordinates():
    """Two cranks at half speed, and a point coordinate tied to an angle."""
    m = nc.Mechanism("tied")
    m.ground("A", (0, 0))
    m.point("B", (1, 0))
    m.point("C", (0, 2))
    m.point("S", (0, 5), fixed="y")
    m.body("one", ["A", "B"])
    m.body("two", ["A", "C"])
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="A", to="C")
    m.relation("half", {"phi": 1.0, "psi": -2.0})
    m.relation("tie", {"S.x": 1.0, "phi": -0.25}, constant=0.5)
    u = np.linspace(0.0, 12.0, 61)
    mo = nc.sweep(m.compile(), {"phi": u})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["psi"], np.pi / 2 + u / 2, atol=1e-12)
    np.testing.assert_allclose(mo["S.x"], 0.5 + 0.25 * u, atol=1e-12)


def test_weld_makes_one_body_of_two():
    def build(welded):
        m = nc.Mechanism("frame")
        m.ground("A", (0, 0))
        m.ground("D", (4, 0))
        for name, at in {"B": (0.5, 0.9), "C": (3.3, 2.9), "P": (1.8, 2.6), "Q": (2.2, 3.4)}.items():
            m.point(name, at)
        m.body("crank", ["A", "B"])
        m.body("rocker", ["C", "D"])
        if welded:
            m.body("coupler", ["B", "C"])
            m.body("plate", ["P", "Q"])
            m.weld("seam", "coupler", "plate")
        else:
            m.body("coupler", ["B", "C", "P", "Q"])
        m.angle("phi", at="A", to="B")
        return m.compile()

    a, b = nc.sweep(build(True), {"phi": TURN}), nc.sweep(build(False), {"phi": TURN})
    assert bool(jnp.all(a.converged))
    np.testing.assert_allclose(a["Q"], b["Q"], atol=1e-11)


SPRUNG = nc.constraints.Kind(
    "equidistant",
    lambda p, v, s, c: (((p[2] - p[0]) ** 2).sum() - ((p[2] - p[1]) ** 2).sum(),),
    rows=("equal distance",),
    powers=(2,),
    points=3,
)


def test_a_kind_of_ones_own_takes_the_same_path():
    m = nc.Mechanism("bisector")
    m.ground("A", (0, 0))
    m.ground("D", (2, 0))
    m.point("P", (1.2, 0.5))
    m.constrain("middle", SPRUNG, points=["A", "D", "P"])
    mo = nc.sweep(m.compile(), {"P.y": np.linspace(-1, 1, 11)}, rates={"P.y": 1.0})
    assert bool(jnp.all(mo.converged))
    np.testing.assert_allclose(mo["P.x"], 1.0, atol=1e-14)
    assert m.compile().topology.rows == ("middle: equal distance A-D-P",)


def test_explicit_dimensions_redraw_a_body():
    m = nc.Mechanism("plate")
    m.ground("A", (0, 0))
    for name, at in {"B": (1, 0), "C": (0.5, 1), "D": (1.2, 1.4), "E": (0.2, 0.4)}.items():
        m.point(name, at)
    m.body(
        "plate",
        ["A", "B", "C", "D", "E"],
        lengths={("A", "B"): 4.0, ("A", "C"): 3.0, ("B", "C"): 5.0, ("C", "D"): 2.0},
        local={"E": (1.0, -0.5)},
    )
    m.angle("phi", at="A", to="B")
    mo = nc.solve_position(m.compile(), {"phi": 0.0})
    np.testing.assert_allclose(mo["B"], (4, 0), atol=1e-12)
    np.testing.assert_allclose(mo["C"], (0, 3), atol=1e-12)
    np.testing.assert_allclose(mo["E"], (1, -0.5), atol=1e-12)
    assert float(jnp.linalg.norm(mo["D"] - mo["C"])) == pytest.approx(2.0, abs=1e-12)
    w = np.array([0.7, 0.4])
    np.testing.assert_allclose(mo["D"] - mo["C"], 2 * w / np.linalg.norm(w), atol=1e-12)


def test_a_body_of_one_point_follows_its_line():
    m = nc.Mechanism("block")
    m.ground("A", (0, 0))
    m.point("L", (3, 0.0))
    m.point("S", (1.0, 0.0))
    m.body("arm", ["A", "L"])
    m.body("block", ["S"])
    m.slot("slot", "S", ("A", "L"))
    m.marker("top", on="block", at=(1.0, 0.2))
    m.angle("phi", at="A", to="L")
    m.distance("s", "A", "S", along="L")
    mo = nc.solve_position(m.compile(), {"phi": np.pi / 2, "s": 2.0})
    np.testing.assert_allclose(mo["top"], (-0.2, 2.0), atol=1e-12)


# -- the source's own equations of library mechanisms -----------------------------------------------------------------

SOURCE = {
    "gear_pair": [  # (45), (46)
        "(y_B - y_A) (y_P1 - y_A) + (x_B - x_A) (x_P1 - x_A) - L_AB L_AP1 cos φ = 0",
        "(y_A - y_B) (y_P2 - y_B) + (x_A - x_B) (x_P2 - x_B) - L_AB L_BP2 cos ψ = 0",
    ],
    "rolling_disc": [  # (54)-(60); the sign of (60) is the drawing's (erratum 7)
        "(x_P2 - x_P1)^2 + (y_P2 - y_P1)^2 - L_P1P2^2 = 0",
        "(x_P3 - x_P1)^2 + (y_P3 - y_P1)^2 - L_P1P3^2 = 0",
        "(x_B - x_A) (x_P1 - x_P3) + (y_B - y_A) (y_P1 - y_P3) = 0",
        "(x_B - x_A) (y_P3 - y_A) - (y_B - y_A) (x_P3 - x_A) = 0",
        "(y_P3 - y_P1) (y_P2 - y_P1) + (x_P3 - x_P1) (x_P2 - x_P1) - L_P1P3 L_P1P2 cos φ = 0",
        "x_P3 - (x_B - x_A) s/L_AB - x_A = 0",
        "s + R_rolling φ - c_rolling = 0",
    ],
    "generic_mechanism": [  # (66), (70)-(75)
        "(x_P5 - x_P3)^2 + (y_P5 - y_P3)^2 - L_P3P5^2 = 0",
        "(x_C - x_B) (x_P3 - x_P4) + (y_C - y_B) (y_P3 - y_P4) - c_guide = 0",
        "(x_P2 - x_P1) (y_P6 - y_P1) - (y_P2 - y_P1) (x_P6 - x_P1) = 0",
        "(x_P2 - x_P1) (x_P5 - x_P6) + (y_P2 - y_P1) (y_P5 - y_P6) = 0",
        "(y_P6 - y_P5) (y_P7 - y_P5) + (x_P6 - x_P5) (x_P7 - x_P5) - L_P5P6 L_P5P7 cos φ = 0",
        "x_P6 - x_P1 - s (x_P2 - x_P1)/L_P1P2 = 0",
        "s + R_rolling φ - c_rolling = 0",
    ],
}


@pytest.mark.parametrize(
    ("name", "n", "rows"), [("gear_pair", 6, 5), ("rolling_disc", 8, 7), ("generic_mechanism", 16, 15)]
)
def test_library_mechanisms_as_the_source_prints_them(name, n, rows):
    drawn = getattr(nc.library, name)()
    before = drawn.compile().topology
    m = drawn.in_form("text")
    f = nc.formulate(m, "mixed")
    assert (f.n, f.rows, f.r, f.g) == (n, rows, rows, 1)
    written = str(f.equations()).splitlines()
    assert [e for e in SOURCE[name] if e not in written] == []
    assert name == "gear_pair" or len(SOURCE[name]) == 7
    # The other one is left alone, and the way back leads to it.
    assert drawn.compile().topology == before == m.in_form("exact").compile().topology


def test_a_rolling_disc_moves_the_same_by_the_sources_equations():
    m = nc.library.rolling_disc(angle=1.2)
    phi = np.linspace(0.3, 2.8, 26)
    a, b = (nc.sweep(x.compile(), {"phi": phi}) for x in (m, m.in_form("text")))
    assert bool(jnp.all(a.converged & b.converged))
    for name in ("P1", "P2", "s"):
        np.testing.assert_allclose(a[name], b[name], atol=1e-12)
    np.testing.assert_allclose(b["s"], 0.2 - 0.1 * (phi - 1.2), atol=1e-12)


def test_forms_of_a_whole_mechanism_are_checked():
    m = nc.library.slider_crank()
    with pytest.raises(nc.MechanismError, match="form='texts'; use one of exact, text"):
        m.in_form("texts")
    with pytest.raises(nc.MechanismError, match=r"angle='sine x'.*exact.*switched"):
        m.in_form("text", angle="sine x")
    assert {a.form for a in m.in_form("text", angle="redundant").model.angles.values()} == {"redundant"}


def test_three_points_in_space_by_three_distances():
    """(97)-(99); a triangle hinged at two of its points turns as it does by a distance and a scalar product."""
    m = nc.Mechanism("triangle", dim=3)
    for name, at in {"1": (0, 0, 0), "2": (1, 0.2, 0), "3": (0.3, 1, 0.4)}.items():
        m.point(name, at)
    m.body("plate", ["1", "2", "3"], form="text")
    f = nc.formulate(m, "natural")
    pairs = (("1", "2"), ("1", "3"), ("2", "3"))
    want = {f"(x_{b} - x_{a})^2 + (y_{b} - y_{a})^2 + (z_{b} - z_{a})^2 - L_{a}{b}^2 = 0" for a, b in pairs}
    assert set(str(f.equations()).splitlines()) == want
    assert (f.n, f.rows, f.r, f.g) == (9, 3, 3, 6)

    def hinged(form):
        h = nc.Mechanism("flap", dim=3)
        h.ground("1", (0, 0, 0))
        h.ground("2", (1, 0.2, 0))
        h.point("3", (0.3, 1, 0.4))
        h.body("plate", ["1", "2", "3"], form=form)
        h.angle("phi", at="1", to="3", about=("1", "2"))
        return nc.sweep(h.compile(), {"phi": np.linspace(0.0, 6.0, 13)})

    a, b = hinged("exact"), hinged("text")
    assert bool(jnp.all(a.converged & b.converged))
    np.testing.assert_allclose(a["3"], b["3"], atol=1e-12)
