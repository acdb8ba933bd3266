"""Mobility, diagnosis and the classical quantities of planar mechanisms."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from mechanisms import four_bar, slider_crank, turn

import jaxnc as nc
from jaxnc.reporting.checked import count, oddities
from jaxnc.reporting.verdict import Verdict
from jaxnc.solvers.assembly import derive, to_host
from jaxnc.system import host, structure


def test_mobility_of_a_four_bar():
    report = nc.mobility(four_bar())
    assert (report.n, report.rows, report.rank, report.dof, report.grubler) == (7, 6, 6, 1, 1)
    assert not report.redundant and not report.conflicting and report.momentary == 0
    assert "degrees of freedom 1" in str(report)


def test_redundant_and_momentarily_singular_are_told_apart():
    m = nc.Mechanism("flat")
    m.ground("A", (0, 0))
    m.ground("D", (3, 0))
    m.point("B", (1, 0))
    m.point("C", (4, 0))
    m.body("one", ["A", "B"])
    m.body("two", ["D", "C"])
    m.body("coupler", ["B", "C"])
    report = nc.mobility(m.compile())
    assert (report.dof, report.momentary, report.redundant) == (1, 1, ())
    assert "singular" in str(report)


def test_the_report_says_which_way_solves_take():
    report = nc.mobility(four_bar())
    assert report.driven == ("phi",) and sum(report.blocks) == report.n - 1
    assert nc.mobility(four_bar(), driven="phi").solves == report.solves  # one name is no row of letters
    assert "closed form" in report.solves and report.solves in str(report)
    platform = nc.library.stewart_platform().compile()
    report = nc.mobility(platform)
    assert report.blocks == (18,) and "Newton on 18 unknowns" in report.solves and "multiplications" in report.solves
    with pytest.raises(nc.InputError, match="too few"):
        nc.mobility(platform, driven=["s1"])


def test_other_inputs_take_another_way():
    wishbones = nc.library.double_wishbone().compile()
    hub = nc.mobility(wishbones, driven=["damper", "tie_outer.y", "rim.x"])
    other = nc.mobility(wishbones, driven=["rim.z", "tie_outer.y", "rim.x"])
    assert hub.driven != other.driven and hub.solves != other.solves


def test_what_is_too_large_is_said_to_be_solved_pose_by_pose():
    chain = nc.library.four_bar_chain(60)
    assert "122 unknowns" in nc.mobility(chain.compile()).solves
    kept_sparse = nc.mobility(chain.compile(sparse=True))
    assert "sparse" in kept_sparse.solves and "host" in kept_sparse.solves and kept_sparse.driven == ("phi",)


def test_structure_without_freedom():
    m = nc.Mechanism("truss")
    m.ground("A", (0, 0))
    m.ground("D", (3, 0))
    m.point("B", (1, 2))
    m.body("one", ["A", "B"])
    m.body("two", ["D", "B"])
    system = m.compile()
    assert nc.mobility(system).dof == 0
    pose = nc.solve_position(system, {})
    np.testing.assert_allclose(pose["B"], (1, 2), atol=1e-14)


def test_diagnosis_finds_the_smallest_single_change():
    """Crank tip to fixed pivot is further than coupler and rocker reach: closed forms of what is missing."""
    system = four_bar().replace({"rocker.O4-B": 0.01, "coupler.A-B": 0.03})
    angle = 2.5
    found = nc.diagnose(system, {"phi": angle})
    A = 0.04 * np.array([np.cos(angle), np.sin(angle)])
    missing = np.hypot(A[0] - 0.1, A[1]) - 0.04
    assert not found.assembles and found.violations
    changes = {r.dimension: r.change for r in found.remedies}
    assert changes["length O4-B of rocker"] == pytest.approx(missing, abs=1e-10)
    whole = "length A-B of coupler (all of it in proportion)"  # its tracing point goes along
    assert changes[whole] == pytest.approx(missing, abs=1e-10)
    assert abs(found.remedies[0].change) <= missing + 1e-12
    sizes = [abs(r.change) for r in found.remedies]
    assert sizes == sorted(sizes)
    text = str(found)
    assert "does not assemble at phi = 2.5" in text and "length O4-B of rocker: 0.01" in text
    assert nc.diagnose(four_bar(), {"phi": angle}).assembles
    # The remedy works: a little more than the change closes the mechanism.
    for name, key in (("length O4-B of rocker", "rocker.O4-B"), (whole, "coupler.A-B")):
        mended = system.replace({key: float(system[key]) + 1.001 * changes[name]})
        closed = nc.solve_position(mended, {"phi": angle}, start={"A": A, "B": 0.5 * A + [0.05, 0.0]}, throw=False)
        assert int(closed.status) == 0


def test_remedies_are_those_of_the_loop_that_fails():
    """A second loop behind it, which would close, takes nothing from them."""
    m = nc.Mechanism("wiper pair", length_unit="mm")
    for name, at in {"M": (0, 0), "A": (150, 40), "B": (-400, 30)}.items():
        m.ground(name, at)
    for name, at in {"C": (35, 20), "P": (140, 120), "Q": (-412, 112)}.items():
        m.point(name, at)
    m.body("crank", ["M", "C"], lengths={("M", "C"): 400.0})
    for name, ends in {"rod": "CP", "blade": "PA", "second rod": "PQ", "second blade": "QB"}.items():
        m.body(name, list(ends))
    found = nc.diagnose(m.compile())
    too_long = 400 - np.hypot(150, 40) - np.hypot(10, 80) - np.hypot(105, 100)
    smallest = {r.dimension: r.change for r in found.remedies[:2]}
    assert smallest == {
        "length M-C of crank": pytest.approx(-too_long, abs=1e-8),
        "length C-P of rod": pytest.approx(too_long, abs=1e-8),
    }


def test_a_single_bar_that_is_too_short_is_diagnosed():
    m = nc.Mechanism("bar")
    m.ground("A", (0, 0)), m.point("P", (0.5, 2), fixed="y")
    m.body("bar", ["A", "P"], lengths={("A", "P"): 1.0})
    found = nc.diagnose(m.compile())
    assert {r.dimension: r.change for r in found.remedies}["length A-P of bar"] == pytest.approx(1.0, abs=1e-9)


def test_messages_show_degrees_where_the_mechanism_does():
    m = nc.Mechanism("crank", angle_unit="deg")
    m.ground("A", (0, 0)), m.ground("D", (4, 0)), m.point("B", (2, 2)), m.point("C", (3.3, 2.9))
    for body in ("AB", "BC", "CD"):
        m.body(body, list(body))
    m.angle("phi", at="A", to="B")
    system = m.compile()
    ends = nc.travel(system, "phi")
    for said in (str(ends), str(nc.diagnose(system, {"phi": np.pi}))):
        assert f"{np.degrees(ends.upper):.6g}"[:6] in said and "°" in said
    with pytest.raises(nc.AssemblyError, match=f"as far as phi = {np.degrees(ends.upper):.6g}°"):
        nc.solve_position(system, {"phi": np.pi})


@pytest.mark.parametrize(
    ("crank", "rod", "height"), [(0.83, 0.91, 2.2), (0.85, 0.85, 2.15), (0.68, 0.79, 2.15), (0.35, 0.35, 2.5)]
)
def test_what_does_not_assemble_keeps_its_freedoms(crank, rod, height):
    """A line too far off for crank and rod: in the closest pose their rows are dependent, which is no freedom."""
    m = nc.Mechanism("slider-crank")
    m.ground("A", (0, 0))
    m.point("B", (0, 1))
    m.point("C", (3, height), fixed="y")
    m.body("crank", ["A", "B"], lengths={("A", "B"): crank})
    m.body("rod", ["B", "C"], lengths={("B", "C"): rod})
    m.angle("phi", at="A", to="B")
    system = m.compile()
    found = nc.mobility(system)
    assert (system.degrees_of_freedom, found.dof, found.rank, found.momentary) == (1, 1, 3, 0)
    assert not found.redundant and "does not assemble" in str(found)
    said = nc.diagnose(system, {"phi": 1.0})
    assert not said.assembles and not said.reached and "its drawing does not assemble either" in str(said)
    with pytest.raises(nc.AssemblyError, match="Even the drawing does not assemble"):
        nc.solve_position(system, {"phi": 1.0})


def test_whether_it_assembles_does_not_depend_on_the_unit():
    """A line 1e-7 of the size too far off, in metres or nanometres: angles are no lengths to be rounded beside."""
    gaps = []
    for unit in (1.0, 1e-9, 1e-6, 1e6):
        m = nc.Mechanism("slider-crank")
        m.ground("A", (0, 0))
        m.point("B", (0, unit))
        m.point("C", (3 * unit, (1.74 + 1e-7) * unit), fixed="y")
        m.body("crank", ["A", "B"], lengths={("A", "B"): 0.83 * unit})
        m.body("rod", ["B", "C"], lengths={("B", "C"): 0.91 * unit})
        m.angle("phi", at="A", to="B")
        found = nc.diagnose(m.compile())
        assert not found.assembles and 1e-8 * unit < found.gap < 1e-7 * unit
        gaps.append(found.gap / unit)
        found = nc.diagnose(m.compile().replace({"C": (3 * unit, 2.2 * unit)}))
        assert {r.dimension.split(" of ")[0] for r in found.remedies} == {"A.y", "C.y", "length A-B", "length B-C"}
        np.testing.assert_allclose([abs(r.change) / unit for r in found.remedies], 2.2 - 0.83 - 0.91, rtol=1e-9)
    np.testing.assert_allclose(gaps, gaps[0], rtol=1e-6)


def test_rows_that_contradict_each_other_are_still_dependent():
    """Three wheels on one rod turn together; with one a little too large they still would, but for what is missing."""
    m = nc.Mechanism("coupled wheels")
    for k in range(3):
        m.ground(f"O{k}", (2 * k, 0))
        m.point(f"P{k}", (2 * k + 0.3, 0.4))
        m.body(f"wheel{k}", [f"O{k}", f"P{k}"], lengths={(f"O{k}", f"P{k}"): 0.5005 if k == 2 else 0.5})
    m.body("rod", ["P0", "P1", "P2"])
    m.angle("phi", at="O0", to="P0")
    found = nc.mobility(m.compile())
    assert found.dof == 1 and len(found.redundant) == 1 and found.conflicting


def test_grashof_types():
    assert nc.kinematics.grashof_type(4, 1, 3.5, 3).type == "crank-rocker"
    assert nc.kinematics.grashof_type(1, 3, 3.5, 4).type == "double-crank"
    assert nc.kinematics.grashof_type(4, 3, 1, 3.5).type == "double-rocker"
    assert nc.kinematics.grashof_type(4, 3.5, 3, 1).type == "rocker-crank"
    assert nc.kinematics.grashof_type(4, 2.4, 3.1, 2).type == "triple-rocker"
    assert nc.kinematics.grashof_type(3, 1, 3, 1).type == "change-point"
    assert nc.grashof(four_bar(), "crank", "coupler", "rocker").type == "crank-rocker"
    assert nc.grashof(four_bar(), "crank", "coupler", "rocker").margin == pytest.approx(0.02)
    with pytest.raises(nc.InputError, match=r"'ground' = 9 exceeds the other three"):
        nc.kinematics.grashof_type(9, 1, 2, 3)
    with pytest.raises(nc.InputError, match="no body 'rod'; "):
        nc.grashof(four_bar(), "crank", "rod", "rocker")


def test_transmission_angle_by_the_law_of_cosines():
    u = turn(73)
    mo = nc.sweep(four_bar(), {"phi": u})
    a, b, c, g = 0.04, 0.12, 0.08, 0.1
    span = a * a + g * g - 2 * a * g * np.cos(u)
    mu = np.arccos((b * b + c * c - span) / (2 * b * c))
    np.testing.assert_allclose(nc.transmission_angle(mo, "A", "B", "O4"), np.minimum(mu, np.pi - mu), atol=1e-12)


def test_transmission_angle_in_space():
    system = nc.library.rssr().compile()
    mo = nc.sweep(system, {system.independent[0]: np.linspace(0.3, 0.6, 5)})
    one, two = (np.asarray(mo[name]) - np.asarray(mo["B"]) for name in ("1", "2"))
    cosine = np.sum(one * two, axis=1) / np.linalg.norm(one, axis=1) / np.linalg.norm(two, axis=1)
    found = nc.transmission_angle(mo, "1", "B", "2")
    np.testing.assert_allclose(found, np.arccos(abs(cosine)), rtol=1e-10)


def test_a_row_that_holds_nothing_is_named():
    """A Scotch yoke whose ends slide across its length: that has no slope there, a relation has."""
    yokes = []
    for hold in ("body", "relation"):
        m = nc.Mechanism("yoke")
        m.ground("O", (0, 0)), m.point("P", (0.3, 0.1))
        m.point("S", (0.3, -1), fixed="y"), m.point("T", (0.3, 1), fixed="y")
        m.body("crank", ["O", "P"]), m.angle("phi", at="O", to="P"), m.slot("pin", "P", line=("S", "T"))
        m.body("yoke", ["S", "T"]) if hold == "body" else m.relation("tie", {"S.x": 1, "T.x": -1})
        yokes.append(m.compile())
    found = nc.mobility(yokes[0])
    assert found.idle == ("yoke: length S-T",) and "yoke: length S-T holds nothing to first order" in str(found)
    with pytest.raises(nc.InputError, match=r"too few inputs.*nc\.mobility"):
        nc.sweep(yokes[0], {"phi": [0.3]})
    count(verdict := Verdict(), yokes[0], found)
    assert [f.names for f in verdict.warnings if f.code == "loose"] == [["yoke: length S-T"]]
    phi = np.linspace(0.3, 6.0, 5)
    motion = nc.sweep(yokes[1], {"phi": phi})
    assert nc.mobility(yokes[1]).idle == ()
    np.testing.assert_allclose(motion["T.x"], np.hypot(0.3, 0.1) * np.cos(phi), atol=1e-14)


def test_instant_centres_by_aronhold_kennedy():
    mo = nc.sweep(four_bar(), {"phi": np.linspace(0.3, 2.0, 9)}, rates={"phi": 3.0})
    A, B, O4 = (np.asarray(mo[n]) for n in ("A", "B", "O4"))
    # The coupler's centre lies where the lines of crank and rocker meet.
    centre = np.asarray(nc.instant_centre(mo, "coupler"))
    for a, b in ((np.zeros(2), A), (O4, B)):
        d, w = b - a, centre - a
        np.testing.assert_allclose(d[..., 0] * w[..., 1] - d[..., 1] * w[..., 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(nc.instant_centre(mo, "crank"), 0.0, atol=1e-14)
    np.testing.assert_allclose(nc.instant_centre(mo, "coupler", "rocker"), B, atol=1e-12)
    # Crank against rocker: on the line of the fixed pivots, dividing it in the ratio of the speeds.
    relative = np.asarray(nc.instant_centre(mo, "crank", "rocker"))
    np.testing.assert_allclose(relative[:, 1], 0.0, atol=1e-12)
    ratio = np.asarray(mo.angular_velocity("rocker")) / 3.0
    np.testing.assert_allclose(relative[:, 0] / (relative[:, 0] - 0.1), ratio, atol=1e-9)


def test_translation_has_its_centre_at_infinity():
    m = nc.Mechanism("slide")
    m.point("P", (0, 0), fixed="y")
    m.point("Q", (1, 0), fixed="y")
    m.body("block", ["P", "Q"])
    mo = nc.solve_position(m.compile(), {"P.x": 0.2}, rates={"P.x": 1.0})
    assert np.all(np.isinf(nc.instant_centre(mo, "block")))


def test_singular_values_and_conditioning():
    mo = nc.sweep(slider_crank(), {"phi": turn(9)})
    values = mo.singular_values()
    assert values.shape == (9, 3) and bool(jnp.all(values[:, 0] >= values[:, -1])) and bool(jnp.all(values > 0))
    assert bool(jnp.all((mo.conditioning > 1e-3) & (mo.conditioning <= 1)))


def test_derivatives_of_singular_values():
    """By differences of what NumPy finds; the scales of the equations follow the design too."""
    system = nc.library.four_bar().compile()

    def least(pin):
        return nc.sweep(system.replace({"D": pin}), {"phi": np.linspace(0.5, 0.6, 3)}).singular_values()[:, -1].sum()

    pin = jnp.asarray(system["D"])
    steps = [(least(pin + 1e-6 * e) - least(pin - 1e-6 * e)) / 2e-6 for e in np.eye(2)]
    for slope in (jax.grad(least), nc.jit(jax.grad(least)), jax.jacfwd(least)):
        np.testing.assert_allclose(slope(pin), steps, rtol=1e-6)
    with pytest.raises(nc.InputError, match="second derivative"):
        jax.hessian(least)(pin)


def test_names_are_in_a_motion():
    motion = nc.solve_position(four_bar(), {"phi": 0.7})
    assert "B" in motion and "B.x" in motion and "phi" in motion and "nobody" not in motion and 0 not in motion


def test_printing():
    text = str(four_bar())
    assert "n = 7 coordinates, 6 constraint rows, rank 6, 1 degree of freedom" in text
    assert "rocker.O4-B" in text and "phi" in text
    assert repr(nc.sweep(four_bar(), {"phi": turn(9)})) == "Motion('four-bar': 9 poses driven by phi, all converged)"


def test_derivatives_by_dimensions_of_kinds_that_cannot_be_read(monkeypatch):
    """Through JAX they are what they are read as."""
    system = slider_crank(False)
    eq = to_host(derive(system))
    where = [(b, 0, k) for b, block in enumerate(eq.topology.blocks) for k in range(len(block.kind.constants))]
    slots = [*where, 0]
    rng = np.random.default_rng(5)
    q = eq.home[:, None] + 0.01 * rng.standard_normal((len(eq.home), len(slots)))
    change, factors = rng.standard_normal(len(slots)), rng.standard_normal((len(eq.topology.rows), len(slots)))
    read = host.Expansion(eq, slots)(q, change, factors)
    for known in (host._expanded_rows, structure.row_derivatives):
        known.cache_clear()
    monkeypatch.setattr(structure, "program", lambda *_: None)
    through_jax = host.Expansion(eq, slots)(q, change, factors)
    for known in (host._expanded_rows, structure.row_derivatives):
        known.cache_clear()
    for one, other in zip(read, through_jax, strict=True):
        assert np.abs(one).max() > 0.0
        np.testing.assert_allclose(one, other, rtol=1e-12, atol=1e-13)
    # Along the dimension and the pose: central differences of the rows.
    step = 1e-6 * rng.standard_normal((len(eq.home), len(slots)))
    up, down = (host.Expansion(eq, slots)(q + s * step, change + s * 1e-6, factors) for s in (1.0, -1.0))
    both = np.concatenate([step, np.full((1, len(slots)), 1e-6)])
    expected = np.einsum("lrk,kl->rl", read[1], both)
    np.testing.assert_allclose(0.5 * (up[0] - down[0]), expected, rtol=1e-6, atol=1e-14)
    weighted = np.einsum("lrk,rl->lk", up[1] - down[1], factors)
    np.testing.assert_allclose(0.5 * weighted, np.einsum("lab,bl->la", read[2], both), rtol=1e-6, atol=1e-14)


def test_what_a_prompt_shows_is_what_print_shows():
    """Records of arrays filled screens at a prompt: 35 KB for a report."""
    system = nc.library.four_bar(coupler_point=(0.06, 0.05)).compile()
    drive = {"phi": turn(9)}
    for thing in (
        nc.travel(system, "phi"),
        nc.mobility(system),
        nc.diagnose(system, {"phi": 0.0}),
        nc.sensitivity(system, "P", drive),
        nc.grashof(system, "crank", "coupler", "rocker"),
        nc.tolerance(system, drive, "P", {"D": 1e-4}, samples=10, key=jax.random.key(0)),
        nc.report(nc.library.four_bar()),
    ):
        assert repr(thing) == str(thing) and len(repr(thing)) < 2000


def locked_four_bar():
    m = nc.Mechanism("locked")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (0, 1))
    m.point("C", (3.3, 2.9))
    for name, ends in (("crank", "AB"), ("coupler", "BC"), ("rocker", "CD"), ("diagonal", "AC")):
        m.body(name, list(ends))
    m.angle("phi", at="A", to="B")
    return m


def test_bodies_that_lock_each_other_are_named():
    system = locked_four_bar().compile()
    said = r"(?s)'crank'.*'coupler'.*'rocker'.*lock.*leave out body 'diagonal'"
    assert re.search(said, str(nc.mobility(system)))
    for analysis in (nc.sweep, nc.solve_position):
        with pytest.raises(nc.InputError, match=said):
            analysis(system, {"phi": 1.0} if analysis is nc.solve_position else {"phi": np.array([1.0, 1.1])})
    assert not nc.mobility(nc.library.four_bar().compile()).locked


def test_as_many_bodies_as_are_too_many_are_named():
    m = locked_four_bar()
    m.body("brace", ["B", "D"])
    (said,) = nc.mobility(m.compile()).locked
    assert all(repr(name) in said for name in ("crank", "coupler", "rocker"))
    assert said.endswith("leave out body 'diagonal' and body 'brace' and it has 1 degree of freedom")
    del m.model.bodies["diagonal"], m.model.bodies["brace"]
    m.angle("psi", at="D", to="C")
    m.relation("gears", {"phi": 1.0, "psi": -2.0})
    system = m.compile()
    assert "leave out relation 'gears' (or body 'crank'" in nc.mobility(system).locked[0]
    assert "may be" not in str(system)
    with pytest.raises(nc.InputError, match=r"0 degrees of freedom.*1 input"):
        nc.solve_position(system, {"phi": 1.0})


def test_a_check_names_what_no_coordinate_moves(tmp_path):
    m = locked_four_bar()
    del m.model.bodies["diagonal"], m.model.bodies["coupler"]
    found = [finding.text for finding in oddities(m.compile(), m)]
    assert any("rocker" in text and "phi" in text for text in found), found
    whole = locked_four_bar()
    del whole.model.bodies["diagonal"]
    assert not any("rocker" in finding.text for finding in oddities(whole.compile(), whole))


def test_a_row_that_is_redundant_in_every_design_is_not_missed_where_this_one_drew_it_along_an_axis():
    """A ball in a groove that swings in a plane: one of its three rows has no slope there, and two of them count."""
    m = nc.Mechanism("boom", dim=3)
    m.ground("H", (0, 0, 0)), m.ground("G", (0, 1, 0)), m.ground("K", (0.6, 0.2, -0.7))
    m.point("T", (1.0, 0.5, 0.1)), m.point("E", (0.6, 0.2, 0.1))
    m.vector("a", (0, 0, 1)), m.vector("b", (1, 0, 0))
    m.body("boom", ["H", "G", "T", "E"])
    m.body("cylinder", ["K"], vectors=["a", "b"])
    m.slot("rod", "E", ("K", "a"))
    found = nc.mobility(m.compile())
    assert found.dof == 2 and found.redundant == ("rod: alignment xy K-E-a",) and not found.overconstrained
    assert not found.idle


@pytest.mark.parametrize("twice", [False, True])
def test_a_rod_spins_also_where_two_of_its_joints_are_at_one_place(twice):
    m = nc.Mechanism("RSSR", dim=3)
    m.ground("A", (0, 0, 0))
    m.ground("D", (3, 0, 0))
    m.ground_vector("a", (0, 0, 1))
    m.ground_vector("d", (0, 1, 0))
    m.point("B", (1, 0, 0))
    m.point("C", (3, 0, 2))
    m.vector("u", (0, 1, 0))
    m.body("crank", ["A", "B"], vectors=["a"])
    m.body("rocker", ["C", "D"], vectors=["d"])
    if twice:
        m.point("E", (1, 0, 0))
        m.point("F", (2, 0, 1.5))
        m.body("tag", ["E", "F"])
    m.body("rod", ["E", "B", "C"] if twice else ["B", "C"], vectors=["u"])
    assert any("'rod' can spin" in text for text in nc.mobility(m.compile()).loose)


def test_a_point_that_a_relation_holds_is_held():
    m = nc.Mechanism("tied")
    m.ground("A", (0, 0))
    m.point("B", (1.0, 0), fixed="y")
    m.point("C", (0.0, 1.0), fixed="x")
    m.relation("tie", {"B.x": 1.0, "C.y": -2.0}, constant=-1.0)
    system = m.compile()
    assert "nothing holds" not in str(system)
    np.testing.assert_allclose(nc.sweep(system, {"B.x": [1.0, 0.9]})["C"], [[0.0, 1.0], [0.0, 0.95]], atol=1e-12)
