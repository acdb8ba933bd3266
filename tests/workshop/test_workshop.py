"""Parts for a workshop: drawings read back, clearances judged by shapely, stacks by trying them all."""

import csv
import itertools
import json
import os
import re
import sys

import numpy as np
import pytest
from processes import full_disk

import jaxnc as nc
from jaxnc.cli.main import main
from jaxnc.io.drives import sweep_arguments
from jaxnc.workshop.stacking import LayerSearch, Rule
from jaxnc.workshop.stock import Contour

ezdxf, shapely = pytest.importorskip("ezdxf"), pytest.importorskip("shapely")

SIZES = {"width": 16.0, "pin": 5.0, "thickness": 3.0}
POSES, FINER = 73, 5  # asked for, and how many times as many are judged
FLAT = 1e-3  # mm: how far the sides of a judged outline leave its arcs
SURE = 0.02  # of the clearance, or 0.5 %: how well the least distance is known


def scissor():
    return nc.load("examples/scissor_lift.toml")


MAKE = {
    "four-bar": (nc.library.four_bar, {}),
    "slider-crank": (nc.library.slider_crank, {}),
    "jansen": (lambda: nc.library.jansen_leg(scale=0.003), {"width": 12.0, "pin": 4.0}),
    "klann": (lambda: nc.library.klann_leg(scale=0.2), {}),
    "peaucellier": (nc.library.peaucellier_lipkin, {}),
    "scissor": (scissor, {"width": 60.0, "pin": 20.0, "thickness": 10.0}),
    "watt": (nc.library.watt_six_bar, {}),
    "stephenson": (nc.library.stephenson_six_bar, {}),
    "quick return": (nc.library.quick_return, {}),
    "hart": (nc.library.hart, {}),
    "crowded leg": (lambda: nc.library.jansen_leg(scale=0.0017), {"width": 24.0}),
    "crowded inversor": (
        lambda: nc.library.peaucellier_lipkin(arm=0.05, side=0.02, crank=0.02),
        {"width": 12.0, "pin": 3.0},
    ),
    "slider on a bar": (lambda: nc.library.crank_slider_on_bar(crank_angle=True), {}),
}


def moved(mechanism, poses=POSES):
    asked = sweep_arguments(mechanism)
    inputs = {name: np.linspace(v[0], v[-1], poses) for name, v in asked["inputs"].items()}
    return nc.sweep(mechanism.compile(), inputs, hold=asked["hold"])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Motion, assembly and folder of each mechanism, made when first asked for."""
    kept = {}

    def make(name):
        if name not in kept:
            build, sizes = MAKE[name]
            motion = moved(build())
            out = tmp_path_factory.mktemp("parts") / "out"
            kept[name] = motion, motion.to_parts(out, **{**SIZES, **sizes}), out
        return kept[name]

    return make


def table(out, name="parts"):
    return list(csv.DictReader((out / f"{name}.csv").read_text(encoding="utf-8").splitlines()))


STACK = "on it, from below (washers and spacers in mm)"


def drawn(path):
    """Outlines and holes of a DXF file by its layers: polygons, and circles as centres."""
    outlines, circles = {}, {}
    for entity in ezdxf.readfile(path).modelspace():
        layer = entity.dxf.layer
        if entity.dxftype() == "CIRCLE" and "HOLES" in layer:
            circles.setdefault(layer.removesuffix("HOLES"), []).append(
                (complex(entity.dxf.center.x, entity.dxf.center.y), entity.dxf.radius)
            )
        if "OUTLINE" in layer:
            if entity.dxftype() == "CIRCLE":
                ring = complex(entity.dxf.center.x, entity.dxf.center.y) + entity.dxf.radius * np.exp(
                    2j * np.pi * np.linspace(0, 1, 200)
                )
            else:
                parts = entity.virtual_entities()  # exact arcs; ezdxf's paths are Bézier curves, microns off
                points = [p for e in parts for p in (e.flattening(FLAT) if e.dxftype() == "ARC" else (e.dxf.start,))]
                ring = np.array([complex(p.x, p.y) for p in points])
            outlines[layer.removesuffix("OUTLINE")] = ring
    return outlines, circles


@pytest.mark.parametrize("name", MAKE)
def test_nothing_collides_as_an_independent_judge_sees_it(made, name):
    """Outlines from the DXF of the assembly, moved as the bodies move, on five times as many poses, by shapely."""
    motion, assembly, out = made(name)
    shop, rows = assembly.shop, table(out)
    asked = {k: np.asarray(v) for k, v in motion.inputs.items()}
    fine = np.linspace(0, POSES - 1, FINER * (POSES - 1) + 1)
    inputs = {k: np.interp(fine, np.arange(POSES), v) for k, v in asked.items()}
    more = nc.sweep(motion.system, inputs, hold=motion.held).check()
    outlines, circles = drawn(out / "assembly.dxf")
    level = {r["name"]: int(r["layer"]) for r in rows if r["item"] in ("plate", "link", "slider")}
    ring = {r["name"]: k for r, k in zip(rows, outlines, strict=False)}
    assert len(level) == len(outlines) and all(ring[p].startswith(f"{level[p]}-") for p in level)

    def carried(part, z):
        """Places of a part in the first pose, in all poses."""
        bodies = [b for b in motion.system.topology.bodies if b.name == part.split(" + ")[0]]
        if part == "ground":
            return np.broadcast_to(z, (len(fine), len(z)))
        at = np.asarray(more.position(bodies[0].name)) * shop.unit @ [1, 1j]
        turn = np.asarray(more.orientation(bodies[0].name)) if len(bodies[0].points) > 1 else np.zeros(len(fine))
        return at[:, None] + (z - at[0]) * np.exp(1j * (turn - turn[0]))[:, None]

    plates, step = {}, 0.0  # and how far anything moves from one pose to the next
    for part in level:
        z = carried(part, outlines[ring[part]])
        step = max(step, abs(np.diff(z, axis=0)).max())
        plates[part] = shapely.polygons(np.stack([z.real, z.imag], axis=-1))
    holes = {part: {w for w, _ in circles.get(ring[part], [])} for part in level}
    pins = {}
    for row in table(out, "pins"):
        through = [word for word in row[STACK].split(", ") if word in level]
        if row["pin"] in motion.system.topology.points:
            z = np.asarray(more[row["pin"]]) * shop.unit @ [1, 1j]
        else:
            (own,) = [p for p in through if f"{p} guide" == row["pin"]]
            known = [complex(*np.asarray(motion[n])[0]) * shop.unit for n in motion.system.topology.points]
            (w,) = [w for w in holes[own] if min(abs(w - k) for k in known) > 1e-6]
            z = carried(own, np.array([w]))[:, 0]
        pins[row["pin"]] = through, z
        layers = tuple(map(int, row["layers"].split("-")))
        assert [level[p] for p in through] == sorted(level[p] for p in through)
        assert (min(level[p] for p in through), max(level[p] for p in through)) == layers
    found = {}
    for a, b in itertools.combinations(level, 2):
        if level[a] == level[b]:
            found[a, b] = shapely.distance(plates[a], plates[b]).min()
    spans = {p: sorted(level[q] for q in through) for p, (through, _) in pins.items()}
    for (p, (through, z)), part in itertools.product(pins.items(), level):
        if part not in through and spans[p][0] < level[part] < spans[p][-1]:
            gap = shapely.distance(shapely.points(z.real, z.imag), plates[part]).min()
            found[f"pin {p}", part] = gap - shop.spacer / 2
    for (p, (one, z)), (q, (other, w)) in itertools.combinations(pins.items(), 2):
        if max(spans[p][0], spans[q][0]) < min(spans[p][-1], spans[q][-1]):
            assert abs(z - w).min() - shop.spacer > 0
            if not set(one) & set(other):
                found[f"pin {p}", f"pin {q}"] = abs(z - w).min() - shop.spacer
    said = {(p.one, p.other): p.clearance for p in assembly.passing}
    assert set(said) == set(found)
    for pair, gap in found.items():
        slack = max(SURE * shop.clearance, 0.005 * gap) + 4 * FLAT + step
        assert said[pair] - FLAT <= gap < said[pair] + slack, pair
        assert gap >= shop.clearance - 2 * FLAT
    assert assembly.clearance <= min(found.values(), default=np.inf) + FLAT


@pytest.mark.parametrize("name", ["jansen", "quick return", "scissor"])
def test_drawings_read_back_are_true_to_scale(made, name):
    motion, assembly, out = made(name)
    shop = assembly.shop
    for file, *_ in assembly.drawings():
        document = ezdxf.readfile(out / f"{file}.dxf")
        assert document.header["$INSUNITS"] == 4 and not document.audit().has_errors
    home = {p: complex(*np.asarray(motion[p])[0]) * shop.unit for p in motion.system.topology.points}
    rows = {r["name"]: r for r in table(out)}
    for (file, part, *_), made_of in zip(assembly.drawings(), assembly.parts, strict=False):
        outlines, circles = drawn(out / f"{file}.dxf")
        names = rows[part]["holes"].split(", ") if rows[part]["holes"] and "guide" not in rows[part]["holes"] else []
        centres = [w for w, radius in circles.get("", []) if radius == pytest.approx(shop.hole / 2, abs=1e-12)]
        assert not names or len(centres) == len(names) == len(made_of.holes)
        for (p, a), (q, b) in itertools.combinations(zip(names, centres, strict=False), 2):
            assert abs(a - b) == pytest.approx(abs(home[p] - home[q]), abs=1e-9)
        (ring,) = outlines.values()
        length = float(rows[part]["length [mm]"])  # six digits; an outline read as chords is shorter by up to 2 FLAT
        assert length - 2 * FLAT - 1e-3 < np.ptp(ring.real) < length + 1e-3
        if names and not rows[part]["slots [mm]"]:
            assert np.ptp(np.real(centres)) + shop.width == pytest.approx(length, abs=1e-3)
        if names:
            reach = min(abs(ring - w).min() for w in centres)
            assert reach == pytest.approx(shop.width / 2, abs=FLAT)


def test_holes_and_slots_say_their_pins_by_the_numbers_of_the_assembly():
    system = nc.library.slider_crank().compile()
    made = nc.sweep(system, {"phi": np.linspace(0.0, 2.0 * np.pi, 91)}).to_parts(width=20, pin=6, thickness=3)
    holes = [(hole, part) for part in made.parts for hole in part.holes if hole.pin >= 0]
    assert {hole.pin for hole, _ in holes} == set(range(len(made.pins)))
    assert all(made.pins[hole.pin].name == hole.name for hole, _ in holes)
    assert {k for part in made.parts for slot in part.slots for k in slot.pins} <= set(range(len(made.pins)))


def test_points_at_one_place_share_a_hole_that_names_them():
    m = nc.library.four_bar()
    b, c = (np.asarray(m.compile()[name]) for name in "BC")
    for name in ("E", "E2", "E3"):
        m.point(name, (b + c) / 2)
    m.body("plate", ["B", "C", "E", "E2", "E3"])
    made = nc.sweep(m.compile(), {"phi": np.linspace(0.0, 2.0 * np.pi, 37)}).to_parts(width=20, pin=6, thickness=3)
    (row,) = (row for row in made.rows() if "plate" in row[1])
    assert sorted(row[9].split(", ")) == ["B", "C", "E + E2 + E3"]
    (plate,) = (part for part in made.parts if "plate" in part.name)
    assert sum(contour.kind == "hole" for contour in plate.contours(made.shop)) == 3


def test_svg_is_in_millimetres_and_agrees_with_dxf(made):
    _, assembly, out = made("four-bar")
    for name, *_ in assembly.drawings():
        text = (out / f"{name}.svg").read_text()
        wide, high = map(float, re.search(r'width="([\d.]+)mm" height="([\d.]+)mm"', text).groups())
        assert list(map(float, re.search(r'viewBox="([^"]*)"', text)[1].split()))[2:] == [wide, high]
        found = [complex(float(x), -float(y)) for x, y in re.findall(r'class="hole" cx="(\S+)" cy="(\S+)"', text)]
        circles = [w for ring in drawn(out / f"{name}.dxf")[1].values() for w, _ in ring]
        assert len(found) == len(circles) and max(min(abs(w - c) for c in circles) for w in found) < 1e-9
    points = nc.io.outline(out / "coupler.svg", 400).points  # arcs as another reader draws them
    length = 2 * 120 + 16 * np.pi
    assert np.ptp(points, axis=0) == pytest.approx([136, 16], abs=0.05) and np.hypot(
        *np.diff(points, axis=0).T
    ).sum() == pytest.approx(length, rel=0.01)


def test_tables_and_text_say_what_is_to_be_made(made):
    _, assembly, out = made("peaucellier")
    rows, pins, between = table(out), table(out, "pins"), {"washer": [], "spacer": []}
    for row in pins:
        low, high = map(int, row["layers"].split("-"))
        words = row[STACK].split(", ")
        own = [word.split(" ") for word in words if re.fullmatch(r"(washer|spacer) [\d.]+", word)]
        for kind, size in own:
            between[kind].append(float(size))
        high_ = (len(words) - len(own)) * 3 + sum(float(size) for _, size in own)
        assert float(row["length [mm]"]) == pytest.approx(high_) == pytest.approx((high - low) * 3.5 + 3)
    size = {"pin": "length [mm]", "washer": "thickness [mm]", "spacer": "length [mm]"}
    listed = {kind: [(float(r[size[kind]]), int(r["count"])) for r in rows if r["item"] == kind] for kind in size}
    made_of = {"pin": [float(r["length [mm]"]) for r in pins], **between}
    for kind, found in listed.items():  # equal ones in one row, all counted
        assert found == sorted((v, made_of[kind].count(v)) for v in set(made_of[kind]))
    assert (out / "parts.txt").read_text() == f"{assembly}\n"
    assert str(assembly.layers) in str(assembly).splitlines()[0]


def test_masses_are_those_of_what_is_drawn(made, tmp_path):
    motion = made("quick return")[0]
    steel = motion.to_parts(tmp_path, density=7850.0, **SIZES)
    outlines, _ = drawn(tmp_path / "assembly.dxf")
    cut = dict.fromkeys(outlines, 0.0)
    for entity in ezdxf.readfile(tmp_path / "assembly.dxf").modelspace():
        layer = entity.dxf.layer
        if layer.endswith("HOLES") and entity.dxftype() == "CIRCLE":
            cut[layer.removesuffix("HOLES")] += np.pi * entity.dxf.radius**2
        elif layer.endswith("HOLES"):
            sides = [e for e in entity.virtual_entities() if e.dxftype() == "LINE"]
            cut[layer.removesuffix("HOLES")] += np.pi * 2.55**2 + 5.1 * max(
                e.dxf.start.distance(e.dxf.end) for e in sides
            )
    grams = [float(r["mass [g]"]) for r in table(tmp_path) if r["mass [g]"]]
    areas = [shapely.Polygon(np.stack([z.real, z.imag], axis=1)).area - cut[key] for key, z in outlines.items()]
    assert grams == pytest.approx(np.array(areas) * 3 * 7.85e-3, rel=1e-3) and any(p.slots for p in steel.parts)
    assert f"the plates weigh {sum(grams):.4g} g" in str(steel)


def test_names_stand_beside_the_parts_and_are_not_cut(made):
    _, assembly, out = made("four-bar")
    sheet = list(ezdxf.readfile(out / "parts.dxf").modelspace())
    said = {e.dxf.layer: e.dxf.text for e in sheet if e.dxftype() == "TEXT"}
    assert said == {
        f"{v}-{k}-NAMES": f"{p.name}, layer {v}"
        for k, (p, v) in enumerate(zip(assembly.parts, assembly.levels, strict=True))
    }
    ground = drawn(out / "parts.dxf")[0]["0-0-"]
    assert np.ptp(ground.imag) == pytest.approx(16, abs=FLAT)  # a bar lies along x
    assert {e.dxftype() for e in ezdxf.readfile(out / "crank.dxf").modelspace()} == {"LWPOLYLINE", "CIRCLE"}
    for name, count in (("parts", 4), ("assembly", 0), ("crank", 0)):
        text = (out / f"{name}.svg").read_text()
        wide = float(re.search(r'width="([\d.]+)mm"', text)[1])
        assert text.count("<text") == count and all(float(x) < wide for x in re.findall(r'<text[^>]* x="(\S+)"', text))


# -- what cannot be ---------------------------------------------------------------------------------------------------


def test_a_stack_that_cannot_be_names_what_is_in_the_way():
    """Whitworth's arm and crank both turn round over the other's pivot: on one side one must pass the other's pin."""
    motion = moved(nc.library.whitworth())
    says = r"'whitworth' cannot be stacked.*crank and arm share pin A.*O2, of ground and crank, is in the way of arm.*"
    with pytest.raises(nc.AssemblyError, match=says + r"O4, of ground and arm, is in the way of crank.*narrower"):
        motion.to_parts(**SIZES)


def test_too_few_layers_and_how_many_it_takes(made, tmp_path):
    motion, assembly, _ = made("peaucellier")
    few = assembly.layers - 1
    with pytest.raises(nc.AssemblyError, match=rf"{few + 1} layers.*layers={few}.*too few"):
        motion.to_parts(tmp_path / "out", layers=few, **SIZES)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("poses", "sure"), [(14, False), (60, True)])
def test_clearances_hold_where_accelerations_leap_between_poses(poses, sure):
    """A four-bar that is nearly a parallelogram: its rocker is thrown round where the bars lie nearly in line."""
    m = nc.Mechanism("near", length_unit="mm")
    m.ground("A", (0, 0)), m.ground("D", (80, 0)), m.point("B", (0, 40)), m.point("C", (80, 40.5))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    system, ends = m.compile(), np.array([0.5, 2.5]) * np.pi
    found = nc.sweep(system, {"phi": np.linspace(*ends, poses)}).check().to_parts(**{**SIZES, "width": 12, "pin": 4})
    fine = nc.sweep(system, {"phi": np.linspace(*ends, 721)}).check()
    bars = [
        shapely.linestrings(np.stack(np.broadcast_arrays(root, np.asarray(fine[p])), axis=1))
        for root, p in (((0, 0), "B"), ((80, 0), "C"))
    ]
    gap = shapely.distance(*bars).min() - 12
    (near,) = [p.clearance for p in found.passing if (p.one, p.other) == ("crank", "rocker")]
    assert near <= gap and found.unsure is not sure and bool(near > 0.99 * gap) is sure


def pendulums(gap, poses):
    """Two cranks that swing towards each other, and are closest where no pose is."""
    m = nc.Mechanism("two", length_unit="mm")
    m.ground("A", (0, 0)), m.ground("D", (160 + gap, 0)), m.point("B", (100, 0)), m.point("E", (100 + gap, 0))
    m.body("left", ["A", "B"]), m.body("right", ["D", "E"])
    m.angle("phi", at="A", to="B"), m.angle("psi", at="D", to="E")
    return nc.sweep(m.compile(), {"phi": np.array(poses), "psi": np.pi + np.array(poses)})


@pytest.mark.parametrize(("gap", "layers"), [(16.9, 2), (17.1, 1), (26.0, 1)])
def test_what_happens_between_poses_counts(gap, layers):
    found = pendulums(gap, [-0.6, -0.35, 0.35, 0.6]).to_parts(**SIZES)
    assert found.layers == layers
    if layers == 1:  # closest in line: the gap less the rounding of both
        (near,) = [p for p in found.passing if (p.one, p.other) == ("left", "right")]
        assert gap - 16 - 0.02 - 0.005 * gap <= near.clearance <= gap - 16 and near.pose == pytest.approx(1.5, abs=0.05)


@pytest.mark.parametrize("poses", [[2.0, 4.0, 4.3], [-1.0, 1.0, 1.1], [-1.5, -1.4, -1.3, 1.3, 1.4, 1.5]])
def test_a_slot_is_as_long_as_its_pin_goes_between_poses(poses):
    """Poses are few and uneven; two pins of one slider's block are no hindrance."""
    motion = nc.sweep(nc.library.slider_crank(offset=0.0).compile(), {"phi": np.array(poses)})
    made = motion.to_parts(width=14, pin=4, thickness=3)
    phi = np.linspace(poses[0], poses[-1], 2001)
    x = 100 * np.cos(phi) + np.sqrt(300**2 - (100 * np.sin(phi)) ** 2)
    ends = sorted(end.real for slot in made.parts[0].slots for end in slot.ends)
    room = np.array([x.min() - ends[0], ends[-1] - (x.max() + 1.5 * 14)])  # the second pin is 1.5 widths ahead
    assert np.all(room >= 0.999) and np.all(room < 5.0)  # 1 mm is the clearance


def test_poses_too_few_for_a_slot_are_said():
    """A crank that swings between dead points, beyond which its angle does not lead."""
    system = nc.library.slider_crank(crank=0.3, conrod=0.1, offset=0.0, angle=0.1).compile()
    few, many = (nc.circuit(system, "phi", poses=n).to_parts(width=14, pin=4, thickness=3) for n in (12, 200))
    assert few.unsure and "longer slots" in few.said and not many.unsure


def test_pins_do_not_pass_each_other_in_a_slot():
    """Two links on the line of a bar that they slide along: their pins meet where the bar lies flat."""
    m = nc.Mechanism("two on a line", length_unit="mm")
    m.ground("A", (0, 0)), m.ground("G", (80, 40)), m.ground("H", (80, -60))
    m.point("B", (200, 0)), m.point("P", (150, 0)), m.point("Q", (150, 0))
    m.body("bar", ["A", "B"]), m.body("one", ["G", "P"]), m.body("two", ["H", "Q"])
    m.slot("upper", "P", ("A", "B")), m.slot("lower", "Q", ("A", "B")), m.angle("phi", at="A", to="B")
    system, sizes = m.compile(), {**SIZES, "width": 12, "pin": 4}
    with pytest.raises(nc.AssemblyError, match=r"pin P.*pin Q.*slot.*pose 4"):
        nc.sweep(system, {"phi": np.linspace(-0.2, 0.2, 9)}).to_parts(**sizes)
    apart = nc.sweep(system, {"phi": np.linspace(0.03, 0.2, 9)})
    (near,) = [p for p in apart.to_parts(**sizes).passing if (p.one, p.other) == ("pin P", "pin Q")]
    gap = np.linalg.norm(np.asarray(apart["P"] - apart["Q"]), axis=1).min() - 4
    assert gap - 0.05 < near.clearance <= gap and near.pose == 0


def test_motions_that_nothing_drives_are_judged_by_their_poses():
    system = nc.library.four_bar(crank=0.06).compile()
    around = nc.circuit(system, "phi", poses=200)
    found = around.to_parts(**SIZES)
    assert found.layers >= 2 and found.poses == 200


def test_few_poses_are_made_up_for_or_said(made):
    """A leg in steps of 30 degrees: what cannot be looked at between them is kept apart."""
    fine = made("jansen")[1]
    rough = moved(nc.library.jansen_leg(scale=0.003), 13).to_parts(**{**SIZES, "width": 12.0, "pin": 4.0})
    assert rough.unsure and not fine.unsure and rough.layers >= fine.layers
    assert "more of them may need fewer layers" in rough.said and "more of them" not in fine.said
    known = {(p.one, p.other): p.clearance for p in fine.passing}
    both = [(p.clearance, known[p.one, p.other]) for p in rough.passing if (p.one, p.other) in known]
    assert both and all(low <= 1.006 * true + SURE for low, true in both)


def random_rules(rng, count):
    rules = []
    for _ in range(rng.integers(2, 9)):
        i, j, k = rng.choice(np.arange(1, count), 3, replace=False).tolist()
        kind = ("parts", "pin and part", "pins")[rng.integers(3)]
        one, other = {"parts": ((i,), (j,)), "pin and part": ((0, i), (j,)), "pins": ((i, 0), (j, k))}[kind]
        rules.append(Rule(kind, one, other, len(rules)))
    return rules


def test_the_search_agrees_with_trying_every_stack():
    rng, impossible = np.random.default_rng(5), 0
    for _ in range(60):
        count = 5
        rules = random_rules(rng, count)
        pins = [r.one for r in rules if len(r.one) > 1]
        search = LayerSearch(count, rules, pins)
        stacks = [dict(enumerate((0, *levels))) for levels in itertools.product(range(1, count), repeat=count - 1)]
        good = [s for s in stacks if not any(r.broken(s) for r in rules)]
        found = search.fewest(count - 1)
        assert (found is None) == (not good)
        if found is None:
            impossible += 1
            core = search.reasons(count - 1)
            assert not [s for s in stacks if not any(r.broken(s) for r in core)]
            for left in core:  # none can be left out
                assert [s for s in stacks if not any(r.broken(s) for r in core if r is not left)]
            continue
        least = min(max(s.values()) for s in good)
        assert found[1] == least == max(found[0].values())
        assert search.length(found[0]) == min(search.length(s) for s in good if max(s.values()) == least)
    assert 0 < impossible < 60


WRONG = [
    ({"width": -1.0}, "width=-1.0 must be a positive number"),
    ({"pin": float("nan")}, "pin=nan must be a positive number"),
    ({"thickness": "3"}, "thickness='3' must be"),
    ({"width": 6.0}, "width=6 leaves no wall around holes of 5.1 mm; make links at least 7.6 wide"),
    ({"spacer": 30.0}, r"spacer=30; washers are wider than holes \(5.1\) and not wider than links \(16\)"),
    ({"layers": 0}, "layers=0; give how many"),
    ({"unit": 80.0}, r"'crank': the hole of A and that of B are 3.2 mm apart, and need 6.35"),
    ({"clearance": -1}, "clearance=-1 must be a number, 0 or more, in mm"),
    ({"density": 7.85}, "density=7.85; give it in kg/m³: 7850 for steel"),
    ({"widht": 3}, "there is no widht=; did you mean 'width'"),
    ({"formats": 3}, "formats=3; give 'dxf', 'svg' or both"),
    ({"formats": "step"}, "formats=.*'step'.*give 'dxf', 'svg' or both"),
]


@pytest.mark.parametrize(("sizes", "says"), WRONG)
def test_sizes_that_are_none_are_named(made, tmp_path, sizes, says):
    motion, _, _ = made("four-bar")
    with pytest.raises(nc.InputError, match=says):
        motion.to_parts(tmp_path / "out", **{**SIZES, **sizes})
    assert not list(tmp_path.iterdir())


def test_mechanisms_that_plates_do_not_make_are_named():
    with pytest.raises(nc.InputError, match=r"'mesh'.*plates and pins"):
        moved(nc.library.geared_five_bar(), 5).to_parts(**SIZES)
    with pytest.raises(nc.InputError, match=r"'ground'.*slot of O.*Y.*beside"):
        moved(nc.library.scotch_yoke(), 9).to_parts(**SIZES)
    joint = nc.library.cardan_joint()
    with pytest.raises(nc.InputError, match=r"spatial.*planar"):
        moved(joint, 5).to_parts(**SIZES)
    short = nc.library.four_bar().compile().replace({"rocker.C-D": 0.02})
    with pytest.raises(nc.InputError, match=r"pose \d+ of .* failed: .*Give a range"):
        nc.sweep(short, {"phi": np.linspace(0.1, 6, 5)}).to_parts(**SIZES)
    m = nc.Mechanism("parallel", length_unit="mm")
    m.ground("A", (0, 0)), m.ground("D", (80, 0)), m.point("B", (0, 40)), m.point("C", (80, 40))
    m.body("crank", ["A", "B"]), m.body("coupler", ["B", "C"]), m.body("rocker", ["C", "D"])
    m.angle("phi", at="A", to="B")
    system, round_ = m.compile(), np.array([0.5, 2.5]) * np.pi
    with pytest.raises(nc.InputError, match=r"pose 10.*'parallel'.*change point"):
        nc.sweep(system, {"phi": np.linspace(*round_, 41)}).to_parts(**SIZES)
    beside = nc.sweep(system, {"phi": np.linspace(*round_, 42)}).to_parts(**SIZES)
    assert 0.97 * (40 - 16) < beside.clearance <= 40 - 16  # in line, end to end
    m = nc.Mechanism(length_unit="cubit")
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.body("arm", ["A", "B"]), m.angle("phi", at="A", to="B")
    arm = nc.sweep(m.compile(), {"phi": np.linspace(0, 1, 4)})
    with pytest.raises(nc.InputError, match=r"how long is a 'cubit' in mm\? Give unit="):
        arm.to_parts(**SIZES)
    assert arm.to_parts(unit=457.0, **SIZES).layers == 1
    with pytest.raises(nc.InputError, match=r"poses of shape \(\); give a sweep"):
        arm.pose(0).to_parts(unit=457.0, **SIZES)


# -- files ------------------------------------------------------------------------------------------------------------

NAMES = ["a/b", "..", "C:con", "x" * 300, "Kurbel ж", "a b", "parts", "../../up", "nul", "A-B"]


def test_a_scotch_yoke_is_made_whose_guide_passes_beside_the_bearing():
    m = nc.Mechanism("yoke")
    m.ground("O", (0, 0)), m.ground("G", (0.2, 0)), m.ground("H", (0.5, 0)), m.point("P", (0.06, 0.08))
    m.point("S", (0.06, -0.15)), m.point("T", (0.06, 0.15)), m.point("K", (0.26, 0)), m.point("L", (0.36, 0))
    m.body("crank", ["O", "P"]), m.body("yoke", ["S", "T", "K", "L"])
    (
        m.prismatic("guide", line=("G", "H"), on=("K", "L")),
        m.slot("slot", "P", ("S", "T")),
        m.angle("phi", at="O", to="P"),
    )
    motion = nc.sweep(m.compile(), {"phi": np.linspace(0, 2 * np.pi, 37)})
    made = motion.to_parts(width=12, pin=5, thickness=3)
    (slot,) = next(part for part in made.parts if part.name == "yoke").slots
    # The pin goes up and down by the crank's 100 mm, and has some play at either end, less than its radius.
    assert 200.0 <= abs(slot.ends[0] - slot.ends[1]) < 205.0


def test_names_that_are_no_file_names_stay_in_the_folder(tmp_path):
    m = nc.Mechanism("../whole", length_unit="mm")
    for k, name in enumerate(NAMES):
        m.ground(f"G{k}", (0, 200 * k)), m.point(f"P{k}", (50, 200 * k)), m.body(name, [f"G{k}", f"P{k}"])
        m.angle(f"t{k}", at=f"G{k}", to=f"P{k}")
    few = np.linspace(0, 0.1, 3)
    motion = nc.sweep(m.compile(), {f"t{k}": few for k in range(len(NAMES))})
    found = motion.to_parts(tmp_path / "in" / "out", **SIZES)
    out = tmp_path / "in" / "out"
    assert os.listdir(tmp_path) == ["in"] and os.listdir(tmp_path / "in") == ["out"]
    files = os.listdir(out)
    assert len({f.casefold() for f in files}) == len(files) == 2 * (len(NAMES) + 3) + 4
    assert all(len(f.encode()) < 140 and re.fullmatch(r"[\w.-]+", f) for f in files)
    assert {"a-b.dxf", "a-b-2.dxf", "a-b-3.dxf", "parts-2.svg", "part-nul.svg", "c-con.dxf", "part.dxf"} <= set(files)
    assert [r["name"] for r in table(out)][1 : len(NAMES) + 1] == [p.name for p in found.parts[1:]] == NAMES


def test_nothing_is_half_written(made, tmp_path, monkeypatch):
    _, assembly, _ = made("four-bar")
    if sys.platform != "win32":
        with full_disk(), pytest.raises(nc.OutputError, match="too large"):
            assembly.save(tmp_path / "full")
        assert not list((tmp_path / "full").iterdir())
    monkeypatch.setitem(sys.modules, "ezdxf", None)
    with pytest.raises(nc.JaxncError, match=r"DXF.*jaxnc\[dxf\].*formats="):
        assembly.save(tmp_path / "none")
    assert not (tmp_path / "none").exists()
    assert (assembly.save(tmp_path / "svg", "svg") / "crank.svg").exists()


def test_the_command(tmp_path, capsys):
    file = nc.library.four_bar().save(tmp_path / "m.toml")
    sizes = ["--width", "16", "--pin", "5", "--thickness", "3", "--no-cache"]
    assert main(["parts", str(file), *sizes, "--out", str(tmp_path / "out"), "--format", "svg"]) == 0
    said = capsys.readouterr().out
    assert "4 plates of 3 mm in 2 layers" in said and re.search(r"4[34]\.?\d* mm stay between", said)
    assert "crank.svg" in os.listdir(tmp_path / "out") and "crank.dxf" not in os.listdir(tmp_path / "out")
    assert main(["parts", str(file), *sizes, "--layers", "1"]) == 1
    assert "needs 2 layers above its ground plate" in capsys.readouterr().err
    assert main(["parts", str(file), *sizes, "--layers", "1", "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert (said["assembles"], said["moves"], said["does"]) == (True, True, False)


def test_the_picture_shows_every_part_and_pin(made):
    _, assembly, _ = made("jansen")
    figure = assembly.draw(pose=-1)
    gids = [a.get_gid() for ax in figure.axes for a in ax.get_children()]
    for part in assembly.parts:
        assert gids.count(f"part {part.name}") == 2
    for pin in assembly.pins:
        assert gids.count(f"pin {pin.name}") == 2
    plan = figure.axes[0]
    assert plan.get_window_extent().width / np.ptp(plan.get_xlim()) == pytest.approx(
        plan.get_window_extent().height / np.ptp(plan.get_ylim()), rel=1e-6
    )
    with pytest.raises(nc.InputError, match=r"pose=99: this motion has poses 0 to 72"):
        assembly.draw(pose=99)


def test_contours_are_closed_arcs():
    ends = Contour("outline", np.array([0, 10, 10 + 5j]), 2.0).bulges()
    turns = [4 * np.arctan(bulge) for _, bulge in ends]
    assert sum(turns) == pytest.approx(2 * np.pi) and min(turns) >= 0
    bar = Contour("slot", np.array([0j, 10]), 2.0).bulges()
    assert [b for _, b in bar] == pytest.approx([1, 0, 1, 0])
