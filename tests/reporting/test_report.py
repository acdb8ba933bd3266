"""Reports: the page for people and the verdict for machines, of mechanisms that work and of those that do not."""

import functools
import json
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from places import EXAMPLES

import jaxnc as nc
from jaxnc.cli import main
from jaxnc.cli.question import ready_mechanism
from jaxnc.errors import InputError
from jaxnc.reporting.transmission import transmissions, unexplained_bodies
from jaxnc.reporting.verdict import Verdict, schema

FOUR_BAR = str(EXAMPLES / "four_bar.toml")


@functools.cache
def checker():
    """Its import takes 2 s: of the one worker that has these tests, not of all that collect them."""
    import jsonschema

    return jsonschema.Draft202012Validator(schema())


def told(capsys, *arguments: str, code: int = 0) -> Verdict:
    """The verdict of a command, which is all that it prints, and holds to the schema."""
    assert main([*arguments, "--json"]) == code
    out, err = capsys.readouterr()
    assert err == ""
    data = json.loads(out, parse_constant=lambda word: pytest.fail(f"{word} in JSON"))
    checker().validate(data)
    found = Verdict.from_json(out)
    assert found.exit == code and found.good == (code == 0) and found.version == 1
    return found


def edited(tmp_path: Path, old: str, new: str) -> str:
    text = Path(FOUR_BAR).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "model.toml").write_text(text.replace(old, new), encoding="utf-8")
    return str(tmp_path / "model.toml")


APART = ("C-D = 3 ", "C-D = 30 ")
STRUCTURE = ('crank = ["A", "B"]', 'crank = ["A", "B"]\nstrut = ["A", "C"]')
BEYOND = ("phi = { from = 0, to = 360, poses = 361", "psi = { from = 100, to = 150, poses = 51")
POINTLESS = ("B = [0, 1]", "B = [0, 0]")


# ---------------------------------------------------------------------------------------------------------------
# verdicts


def test_a_verdict_of_what_is_good(capsys):
    found = told(capsys, "check", FOUR_BAR)
    assert (found.assembles, found.moves, found.does) == (True, True, True) and not found.findings
    assert (found.counts.unknowns, found.counts.equations, found.counts.rank, found.counts.freedoms) == (8, 7, 7, 1)
    assert found.reach[0].turns and found.reach[0].lower is None and found.drives[0].last == 360.0
    ran = told(capsys, "run", FOUR_BAR, "--expect", "psi range > 40.9", "--expect", "transmission > 50")
    assert ran.poses.found == 361 and all(e.met for e in ran.expectations)
    psi = next(e for e in ran.extremes if e.quantity == "psi")
    coupler = np.hypot(3.3, 1.9)  # the rocker is extreme where crank and coupler lie in line
    dead = [180 - np.degrees(np.arccos((16 + 9 - (coupler + s) ** 2) / 24)) for s in (1, -1)]
    assert [psi.smallest, psi.largest] == pytest.approx(dead, abs=1e-3)
    least = np.degrees(np.arccos((coupler**2 + 9 - 3**2) / (6 * coupler)))  # where the crank points at the pivot
    assert ran.expectations[1].value == pytest.approx(least, abs=1e-9)


@pytest.mark.parametrize(
    ("pair", "code", "says"),
    [
        pytest.param(APART, 1, ("does-not-assemble", False, None), id="apart"),
        pytest.param(STRUCTURE, 1, ("cannot-be-driven", True, False), id="structure"),
        pytest.param(BEYOND, 1, ("not-found", True, True), id="beyond"),
        pytest.param(POINTLESS, 2, ("bad-input", None, None), id="pointless"),
    ],
)
def test_a_verdict_of_what_is_not(capsys, tmp_path, pair, code, says):
    found = told(capsys, "check", edited(tmp_path, *pair), code=code)
    assert (found.errors[0].code, found.assembles, found.moves) == says
    assert found.does is (None if code == 2 else False) and found.summary == found.errors[0].text
    if says[0] == "does-not-assemble":  # the rocker can be as long as the ground, crank and coupler together
        best = next(r for r in found.errors[0].remedies if "C-D" in r.dimension)
        assert best.becomes == pytest.approx(5 + np.hypot(3.3, 1.9), abs=1e-6)


@pytest.mark.parametrize("command", [("run",), ("compare",), ("export", "--to", "urdf")], ids=lambda words: words[0])
def test_every_command_says_that_it_does_not_assemble(capsys, tmp_path, monkeypatch, command):
    model = edited(tmp_path, *APART)
    monkeypatch.chdir(tmp_path)
    found = told(capsys, command[0], model, *command[1:], code=1)
    assert found.assembles is False and found.does is False and not found.moves
    (said,) = (f for f in found.errors if f.code == "does-not-assemble")
    assert any("C-D" in change.dimension for change in said.remedies)
    assert [p.name for p in tmp_path.iterdir()] == ["model.toml"]


def test_a_change_point_is_no_failure(capsys, tmp_path):
    """A parallelogram goes on through the poses in which all its bars lie in line."""
    m = nc.Mechanism("parallel")
    m.ground("A", (0, 0)), m.ground("D", (2, 0)), m.point("B", (0, 1)), m.point("C", (2, 1))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    verdict = nc.report(m).verdict
    assert verdict.good and verdict.poses.asked - verdict.poses.found == 2
    (found,) = verdict.warnings
    assert found.code == "singular" and "2 of 181 poses are change points, the first at phi = 3.14159 rad" in found.text
    m.save(tmp_path / "m.toml")
    for drive, code, words in (
        ("phi=90deg:450deg:41", 0, ["2 of 41 poses at change points", "half of the digits"]),
        ("phi=0deg:90deg:10", 1, ["1 of 10 poses FAILED", "begin beside it"]),
    ):
        assert main(["run", str(tmp_path / "m.toml"), "--input", drive]) == code
        out = capsys.readouterr().out
        assert all(word in out for word in words) and "can go no further" not in out, out


def test_json_in_front_of_a_command_is_refused(capsys):
    found = told(capsys, "--json", "check", FOUR_BAR, code=2)  # `told` appends it, too
    assert found.errors[0].code == "bad-input" and "--json" in found.summary


def test_an_expectation_that_is_missed_fails_the_run(capsys):
    found = told(capsys, "run", FOUR_BAR, "--poses", "37", "--expect", "P.y largest <= 2", code=1)
    assert found.assembles and found.moves and found.does is False
    assert found.errors[0].code == "expectation-missed" and "it is 2.6" in found.errors[0].text
    assert main(["run", FOUR_BAR, "--poses", "37", "--expect", "P.y largest <= 2"]) == 1
    assert "expected P.y largest <= 2: it is 2.6" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["run", "nothing.toml"], "no such file"),
        (["run", FOUR_BAR, "--input", "fi=0:1"], "'fi'"),
        (["run", FOUR_BAR, "--expect", "psi is fine"], "write QUANTITY"),
        (
            ["run", FOUR_BAR, "--poses", "5", "--expect", "pso > 1"],
            "--expect 'pso > 1': 'four-bar' has no",
        ),
        (["run", FOUR_BAR, "--poses", "many"], "'many'"),
        (["report", "four-barr"], "did you mean 'four-bar'"),
        (["report", FOUR_BAR, "--poses", "5", "--out", "page.txt"], "end it in .html"),
        (["demo", "slider-cranc"], "did you mean 'slider-crank'"),
    ],
)
def test_mistakes_are_verdicts_too(capsys, arguments, says):
    found = told(capsys, *arguments, code=2)
    assert found.errors[0].code == "bad-input" and says in found.errors[0].text


def test_the_other_commands_have_verdicts(capsys, tmp_path):
    assert len(told(capsys, "demo", "--list").library) > 40
    made = told(capsys, "demo", "slider-crank", "--poses", "13", "--no-pictures", "--out", str(tmp_path))
    assert made.command == "demo" and [Path(f.path).suffix for f in made.files] == [".csv", ".npz"]


@pytest.mark.slow
def test_searches_simulations_and_comparisons_have_verdicts(capsys, tmp_path):
    families = told(capsys, "compare", FOUR_BAR, "--families", "natural").families
    assert [(f.family, f.freedoms) for f in families] == [("natural", 1)] and families[0].variables > 0
    swing = str(EXAMPLES / "swinging_four_bar.toml")
    run = told(capsys, "simulate", swing, "--duration", "0.2", "--times", "11").simulation
    assert run.end == pytest.approx(0.2) and run.steps > 0 and run.violation < 1e-6
    m = nc.load(swing)  # where nothing is driven, a report is of what its section says, here from rest
    m.model.run.inputs.clear()
    m.model.simulate = msgspec.structs.replace(m.model.simulate, duration=0.02, times=2, rates={"phi": 0.0})
    found, text = page_of(tmp_path, m)
    weights = 9.81 * (0.5 * 0.05 + 1.2 * 0.195 + 1.0 * 0.145)  # at the middles of the rods; the spring is as drawn
    assert found.verdict.simulation.energy_start == pytest.approx(weights, rel=1e-12) and found.verdict.does
    assert {e.largest_at["time"] for e in found.verdict.extremes} <= {0.0, 0.02} and not found.transmissions
    assert found.verdict.findings[-1].text.startswith("no sensitivities: they are of poses")
    assert "<h2>Under its forces</h2>" in text and "Range of the inputs" not in text and "time [s]" in text
    rod = nc.Mechanism("rod")  # falls from the side: its rate is greatest below, between two of the times kept
    rod.ground("A", (0, 0)), rod.point("B", (0.6, 0)), rod.angle("phi", at="A", to="B")
    rod.body("rod", ["A", "B"], mass=2.0, shape="rod")
    rod.gravity = (0, -9.81)
    fall = nc.report(nc.simulate(rod.compile(), np.linspace(0, 1, 21)))
    least = next(e for e in fall.verdict.extremes if e.quantity == "v(phi)")
    assert least.smallest == pytest.approx(-np.sqrt(3 * 9.81 / 0.6), rel=1e-3)
    path = str(EXAMPLES / "problems" / "path.toml")
    search = told(capsys, "synthesise", path, "--starts", "64", "--refine", "8", "--seconds", "20").search
    assert search.designs and search.designs[0].error is not None and not search.designs[0].defects


def test_the_schema_is_printed_and_strict(capsys):
    assert main(["--json-schema"]) == 0
    assert json.loads(capsys.readouterr().out) == schema()
    plain = json.loads(Verdict().close(0).to_json())
    checker().validate(plain)
    for wrong in (plain | {"surplus": 1}, plain | {"version": 2}, {k: v for k, v in plain.items() if k != "moves"}):
        assert not checker().is_valid(wrong)
    with pytest.raises(msgspec.ValidationError, match="surplus"):
        Verdict.from_json(json.dumps(plain | {"surplus": 1}))
    odd = Verdict(origin={"a": "b"}).close(1)
    odd.sensitivities = []
    odd.reach = [nc.reporting.verdict.Reach(name="a", unit="", lower=np.nan, upper=np.inf, turns=False, dead_points=[])]
    assert '"lower": null' in odd.to_json() and '"upper": null' in odd.to_json()


# ---------------------------------------------------------------------------------------------------------------
# reports


def page_of(tmp_path: Path, thing, **options) -> tuple[nc.reporting.Report, str]:
    """A report and its page, which loads nothing and runs nothing."""
    found = nc.report(thing, tmp_path / "a" / "page.html", **options)
    text = (tmp_path / "a" / "page.html").read_text(encoding="utf-8")
    addresses = re.findall(r"(?:src|href)=\"(?!data:|#)[^\"]*\"|url\((?!#)[^)]*\)|@import", text)
    said = re.sub(r"base64,[A-Za-z0-9+/=\s]*", "", text)  # a picture's letters may spell anything
    assert not addresses and "<script" not in text and not re.search(r"\bnan\b|NaN|\binf\b", said)
    checker().validate(json.loads(found.verdict.to_json()))
    return found, text


def test_the_page_has_everything(capsys, tmp_path):
    path = tmp_path / "page.html"
    assert main(["report", FOUR_BAR, "--poses", "73", "--out", str(path), "--expect", "psi range > 40"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("four-bar: crank-rocker") and "phi: turns fully" in out and str(path) in out
    text = path.read_text(encoding="utf-8")
    for title in (
        *("Drawing", "Counts", "Range of the inputs", "Curves", "Extremes", "Transmission angle", "Sensitivities"),
        *("The model", "Where it comes from", "What to know"),
    ):
        assert f"<h2>{title}</h2>" in text
    assert "# A crank-rocker with a coupler point." in text and "C-D = 3" in text  # the file as it stands
    assert nc.__version__ in text and "SHA-256" in text and text.count("<svg") == 8


def test_sensitivities_are_derivatives_of_the_motion():
    found = nc.report(nc.load(FOUR_BAR))
    one = next(d for d in found.verdict.sensitivities if (d.output, d.variable) == ("psi", "rocker.C-D"))
    at, step = np.radians(one.at["phi"]), 1e-6
    ends = [found.system.replace({"rocker.C-D": 3.0 + s * step}) for s in (-1, 1)]
    low, high = (float(nc.solve_position(s, {"phi": at})["psi"]) for s in ends)
    assert one.unit == "deg/m" and one.value == pytest.approx(np.degrees(high - low) / (2 * step), rel=1e-6)
    again = nc.report(nc.load(FOUR_BAR)).verdict.origin
    assert again == found.verdict.origin and len(again["model, SHA-256"]) == 64


def test_the_transmission_of_a_slider_crank():
    system = nc.library.slider_crank(crank=0.1, conrod=0.3, offset=0.02).compile()
    turn = nc.sweep(system, {"phi": np.radians([0.0, 90.0, 270.0])})
    (found,) = transmissions(turn)
    assert found.values == pytest.approx(np.degrees(np.arccos(np.abs([0.02, 0.08, 0.12]) / 0.3)), abs=1e-9)


@pytest.mark.parametrize("place", ["on a stand", "with a stay", "on a plate of bars"])
def test_bars_that_close_a_rigid_triangle_transmit_nothing(place):
    """Of a four-bar, one of whose links is made of bars: the angle of coupler and rocker alone."""
    m = nc.Mechanism("four-bar")
    m.ground("A", (0, 0)), m.point("B", (0, 1)), m.point("C", (3.3, 2.9))
    bars = {"crank": "A B", "coupler": "B C", "rocker": "C D"}
    if place == "on a stand":
        m.ground("S1", (3.8, -2)), m.ground("S2", (4.2, -2)), m.point("D", (4, 0))
        bars |= {"leg1": "S1 D", "leg2": "S2 D"}
    else:
        m.ground("D", (4, 0)), m.point("P", (1.7, 2.3))
        bars |= {"one": "B P", "two": "C P"}
        if place == "on a plate of bars":
            m.point("Q", (1.2, 3.0))
            bars |= {"three": "B Q", "four": "P Q"}
    for name, points in bars.items():
        m.body(name, points.split())
    m.angle("phi", at="A", to="B")
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 37)})
    (found,) = transmissions(motion)
    v, w = (np.asarray(motion[end] - motion["C"]) @ [1, 1j] for end in "BD")
    np.testing.assert_allclose(np.sin(np.radians(found.values)), np.abs(np.sin(np.angle(v / w))), atol=1e-9)
    assert found.at == "C" and not unexplained_bodies(motion)


@pytest.mark.parametrize("order", [("c1", "c2"), ("c2", "c1")])
def test_a_cylinder_between_two_moving_links_has_its_transmission(order):
    m = nc.Mechanism("arm")
    for name, at in {"O": (0, 0), "P": (450, -350)}.items():
        m.ground(name, at)
    for name, at in {"Q": (1900, 1500), "T": (4200, 1400), "R": (2300, 2100), "U": (4500, 2100)}.items():
        m.point(name, at)
    m.body("boom", ["O", "Q", "T", "R"])
    m.body("stick", ["T", "U"])
    m.distance("c1", "P", "Q")
    m.distance("c2", "R", "U")
    values = {"c1": np.linspace(2300, 2400, 5), "c2": np.linspace(2600, 2700, 5)}
    motion = nc.sweep(m.compile(), {name: values[name] for name in order})
    at = {name: np.asarray(motion[name]) @ [1, 1j] for name in "OPQRTU"}
    wanted = {"Q": (at["Q"] - at["P"]) / (at["Q"] - at["O"]), "U": (at["U"] - at["R"]) / (at["U"] - at["T"])}
    found = {one.at: np.radians(one.values) for one in transmissions(motion)}
    assert {*found} == {*wanted} and not unexplained_bodies(motion)
    for name, way in wanted.items():
        np.testing.assert_allclose(np.sin(found[name]), np.abs(np.sin(np.angle(way))), atol=1e-9)


def test_the_transmission_of_slots_guides_and_ways_that_cross():
    """Force and velocity drawn by hand: a bar in a block on an arm, a slotted rocker, a ram between two ways."""
    arm, crank, ground = 0.06, 0.1, 0.5
    bar = nc.library.crank_slider_on_bar(crank=crank, ground=ground, arm=arm, bar=0.9, crank_angle=True).compile()
    turn = np.radians([10.0, 100.0, 250.0])
    (found,) = transmissions(nc.sweep(bar, {"phi": turn}))
    pin = crank * np.stack([np.cos(turn), np.sin(turn)], axis=1) - [ground, 0]
    # The block takes no force along the bar, so the force in the pin is normal to it, and passes the pivot in `arm`.
    assert found.values == pytest.approx(np.degrees(np.arccos(arm / np.linalg.norm(pin, axis=1))), abs=1e-9)
    quick = nc.sweep(nc.library.quick_return().compile(), {"phi": turn})
    pin, ram = transmissions(quick)
    assert pin.values == pytest.approx(90.0, abs=1e-9)
    assert ram.values == pytest.approx(np.degrees(np.arctan2(0.42, np.abs(np.asarray(quick["P3"])[:, 0]))), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "at", "left"),
    [
        ("watt-six-bar", ["C", "F"], []),  # nothing at E: the link hangs there on the rocker, and moves the output
        ("four-bar-chain", ["B1", "B2", "B3"], []),
        ("jansen-leg", ["U", "L", "K"], []),
        ("geared-five-bar", ["C"], []),
        ("peaucellier-lipkin", ["A", "C", "P"], []),
        ("chebyshev", [], ["rocker1", "coupler", "rocker2"]),  # its coupler is turned
        ("generic-mechanism", [], ["bar", "link", "slider", "disc"]),
    ],
)
def test_transmission_angles_are_of_what_moves_what(name, at, left):
    m = ready_mechanism(name)
    motion = nc.sweep(m.compile(), **nc.io.drives.sweep_arguments(m), throw=False)
    assert [t.at for t in transmissions(motion)] == at and unexplained_bodies(motion) == left


def driven_rocker(*driven: str) -> nc.Mechanism:
    """Crank A-B, rocker D-C; a rod from C moves S along the ground."""
    m = nc.Mechanism("rocker")
    m.ground("A", (0, 0)), m.ground("D", (4, 0))
    m.point("B", (0, 1)), m.point("C", (3.3, 2.9)), m.point("S", (8, 0), fixed="y")
    m.body("crank", ["A", "B"]), m.body("rocker", ["C", "D"]), m.body("rod", ["C", "S"])
    if "s" in driven:
        m.angle("phi", at="A", to="B"), m.distance("s", "B", "C")
    else:
        m.body("coupler", ["B", "C"]), m.angle("rel", at="B", to="C", start="A")
    return m


def test_an_angle_between_two_links_places_neither():
    system = driven_rocker("rel").compile()
    drawn = float(nc.system.equations.derived(system).home[system.topology.position["rel"]])
    motion = nc.sweep(system, {"rel": drawn + np.linspace(0, 0.1, 3)})
    assert not transmissions(motion) and unexplained_bodies(motion) == ["crank", "rocker", "rod", "coupler"]


def test_a_cylinder_on_a_driven_crank_has_its_transmission():
    values = np.linspace(np.hypot(3.3, 1.9), np.hypot(4, 1) + np.hypot(0.7, 2.9) - 1e-5, 9)
    motion = nc.sweep(driven_rocker("s").compile(), {"phi": np.pi / 2, "s": values})
    found = {one.at: one.values for one in transmissions(motion)}
    # Of the triangle B-C-D two sides are s and the rocker, the third is the way from B to D.
    rocker, way = np.hypot(0.7, 2.9), np.hypot(4, 1)
    angle = np.arccos((values**2 + rocker**2 - way**2) / (2 * values * rocker))
    assert found["C"] == pytest.approx(np.degrees(np.minimum(angle, np.pi - angle)), abs=1e-6)
    assert {*found} == {"C", "S"} and not unexplained_bodies(motion)


@pytest.mark.parametrize("geared", [False, True])
def test_a_planet_is_moved_after_its_carrier(geared):
    m = nc.Mechanism("hesitation")
    m.ground("A", (0, 0)), m.ground("D", (4, 0))
    m.point("B", (0, 1)), m.point("C1", (3.3, 2.9)), m.point("C2", (4.9, -2.5))
    m.body("crank", ["A", "B"]), m.angle("phi", at="A", to="B")
    m.body("coupler1", ["B", "C1"]), m.body("sun", ["D", "C1"])
    m.body("coupler2", ["B", "C2"]), m.body("carrier", ["D", "C2"])
    if geared:
        m.point("P", (4.9, -3.5)), m.body("planet", ["C2", "P"])
        m.angle("s", at="D", to="C1", start="C2"), m.angle("p", at="C2", to="P", start="D")
        m.gear("mesh", "s", "p", radii=(1.5, 1.157))
    motion = nc.sweep(m.compile(), {"phi": np.linspace(1.5, 2.0, 3)})
    found = {one.at: one.values for one in transmissions(motion)}
    assert {*found} == {"C1", "C2"} and not unexplained_bodies(motion)
    angle = np.degrees(np.asarray(nc.transmission_angle(motion, "B", "C2", "D")))
    assert found["C2"] == pytest.approx(angle, abs=1e-9)


def test_a_verdict_says_whether_a_motion_was_followed_to_its_end():
    m = nc.Mechanism("geared five-bar")  # a dead point is some nine turns away
    m.ground("A", (0, 0)), m.ground("D", (1.3741038630441873, 0))
    m.point("B", (-0.41420775730785864, 0.9547253884271694)), m.point("E", (1.7087093779918723, -0.8947672639842976))
    m.point("C", (1.6510377868325772, 1.0900323771673)), m.body("w1", ["A", "B"]), m.body("w2", ["D", "E"])
    m.body("l3", ["B", "C"]), m.body("l4", ["C", "E"])
    m.angle("phi", at="A", to="B"), m.angle("psi", at="D", to="E"), m.gear("g", "phi", "psi", radii=(1.3, 1))
    found = nc.report(nc.sweep(m.compile(), {"phi": np.linspace(2.0, 2.1, 3)}))
    assert found.verdict.reach[0].upper is None and not found.verdict.reach[0].followed
    assert "to no limit found rad" in str(found)
    assert nc.report(nc.library.four_bar()).verdict.reach[0].followed


def test_forces_are_those_of_statics(tmp_path):
    m = nc.Mechanism("lever")
    m.gravity = (0, -9.81)
    m.ground("A", (0, 0))
    m.point("B", (2, 0))
    m.body("rod", ["A", "B"], mass=3.0)
    m.angle("phi", at="A", to="B")
    found, text = page_of(tmp_path, nc.sweep(m.compile(), {"phi": np.linspace(0, 1, 5)}))
    assert found.forces.resting and found.forces.efforts[0].values == pytest.approx(
        3 * 9.81 * np.cos(np.linspace(0, 1, 5)), abs=1e-9
    )
    assert found.forces.peaks[0].by == "point A" and found.forces.peaks[0].force == pytest.approx(3 * 9.81)
    assert "Every pose is held at rest" in text


@pytest.mark.parametrize(
    ("pair", "says"),
    [
        pytest.param(APART, ["does not assemble", "length C-D of rocker", "as it was typed"], id="apart"),
        pytest.param(
            STRUCTURE, ["does not move", "without any one of crank, strut", "as it was drawn"], id="structure"
        ),
        pytest.param(BEYOND, ["does not do what was asked", "were not found", 'class="failed"'], id="beyond"),
        pytest.param(POINTLESS, ["drawn at the same place", "move one of them"], id="pointless"),
    ],
)
def test_the_page_of_what_fails_says_why_and_what_would_mend_it(tmp_path, pair, says):
    found, text = page_of(tmp_path, nc.load(edited(tmp_path, *pair)))
    assert found.verdict.exit == 1 and found.verdict.errors and "<h2>What is wrong</h2>" in text
    assert all(piece in text for piece in says), found.verdict.findings


def test_what_nobody_drives_goes_as_far_as_it_goes(tmp_path):
    m = nc.library.four_bar(4.0, 3.0, 3.5, 3.0)  # no side turns fully against the ground
    m.model.run.inputs.clear()
    found, _ = page_of(tmp_path, m)
    reach = found.verdict.reach[0]
    assert found.verdict.does is None and found.verdict.exit == 0
    assert found.verdict.drives[0].first == pytest.approx(reach.lower, abs=1e-2) and not reach.turns
    assert "nobody said what is driven" in found.verdict.findings[-1].text


def test_names_do_not_break_out_of_the_page(tmp_path):
    m = nc.Mechanism("<b>&'\"", description="</pre><script>alert(1)</script>", length_unit="<u>")
    m.ground("A", (0, 0))
    m.point("<i>", (1, 0))
    m.body("</svg>", ["A", "<i>"])
    m.angle("phi", at="A", to="<i>")
    _, text = page_of(tmp_path, m, expect=["<i>.x smallest < 0"])
    assert not re.findall(r"<i>|<u>|</svg>[^<]|alert\(1\)</script>", text.replace("</svg><", "<"))


def test_suspensions_and_space(tmp_path):
    m = ready_mechanism("macpherson")
    m.model.run.inputs = {n: msgspec.structs.replace(d, poses=9) for n, d in m.model.run.inputs.items()}
    found, text = page_of(tmp_path, m)
    assert [w.over for w in found.verdict.wheels] == ["wheel travel", "rack travel, 10.y"]
    assert "<h2>Suspension over wheel travel</h2>" in text and "var(--ink)" in text and "<image" in text
    toe = next(n for n in found.verdict.wheels[0].numbers if n.name == "toe")
    assert toe.static == pytest.approx(float(found.suspensions[0]["toe"].static))


def test_a_name_that_looks_like_a_part_of_the_page_stays_a_name(tmp_path):
    m = nc.Mechanism("{{BODY}} </title>")
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.body("arm", ["A", "B"])
    nc.report(m, tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<title>{{BODY}} &lt;/title&gt;: report</title>" in text and text.count("<header>") == 1


def test_what_cannot_be_reported_is_refused():
    with pytest.raises(InputError, match=r"Mechanism.*System.*Motion.*str"):
        nc.report("four-bar")  # type: ignore[arg-type]
    system = nc.library.four_bar().compile()
    with pytest.raises(InputError, match="has no poses"):
        nc.report(nc.solve_position(system, {"phi": np.zeros(0)}))


def test_a_report_in_short_begins_with_the_name_once_and_warns_of_nothing():
    said = str(
        nc.report(ready_mechanism("spherical-four-bar"))
    ).splitlines()  # its bodies have only their centre on the ground
    assert said[0] == "spherical four-bar assembles, moves and does what was asked"
    assert not [line for line in said if "warning" in line]


def test_extremes_beside_poses_that_were_not_found_are_between_poses_too():
    """A crank that stops at a dead point, as the poses before it alone: the smallest rate lies between two of these."""
    m = nc.Mechanism("four-bar")
    for name, at in {"A": (0, 0), "D": (4, 0)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.5, 2.0), "C": (3.2, 2.4)}.items():
        m.point(name, at)
    for name, points in {"crank": "AB", "coupler": "BC", "rocker": "CD"}.items():
        m.body(name, list(points))
    m.angle("phi", at="A", to="B")
    m.angle("psi", at="D", to="C")
    system, values = m.compile(), np.linspace(-1.5, 2.6, 14)
    motion = nc.sweep(system, {"phi": values}, rates={"phi": 2.0}, throw=False)
    good = int(np.sum(np.asarray(motion.converged)))
    assert 3 < good < len(values)
    both = [
        next(e for e in nc.report(part, outputs=["psi"]).verdict.extremes if e.quantity == "v(psi)")
        for part in (motion, nc.sweep(system, {"phi": values[:good]}, rates={"phi": 2.0}))
    ]
    assert both[0].smallest == pytest.approx(both[1].smallest, rel=1e-9)
    dense = nc.sweep(system, {"phi": np.linspace(values[0], values[good - 1], 20001)}, rates={"phi": 2.0})
    assert both[0].smallest == pytest.approx(float(np.min(dense.velocity("psi"))), rel=1e-6)
