"""Model files of spatial mechanisms: every record and every joint there and back, and what cannot be read."""

import numpy as np
import pytest
from mechanisms import everything
from rigs import CASES, Rig
from test_files import refusal

from jaxnc.errors import ModelFileError
from jaxnc.io.drives import sweep_arguments
from jaxnc.io.files import blame, load, save
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record
from jaxnc.system.assemble import assemble


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_everything_comes_back_bit_for_bit(tmp_path, suffix):
    m = everything()
    path = save(m, tmp_path / f"all{suffix}")
    back = load(path)
    assert back.model == m.model
    assert repr(back.model) == repr(m.model)
    assert save(back, tmp_path / f"again{suffix}").read_bytes() == path.read_bytes()
    if suffix == ".toml":
        text = path.read_text(encoding="utf-8")
        assert "\nz = [0, 0, 2]\n" in text and 'vectors = ["u", "v"]' in text
        assert max(map(len, text.splitlines())) <= 120


def test_every_record_is_used():
    joints = {type(j) for j in everything().model.joints.values()}
    planar = {record.Gear, record.Skate}  # in space gear() is a bevel gear
    assert joints | planar == set(record.Joint.__args__)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_every_joint_compiles_to_the_same_system(tmp_path, suffix):
    m = Mechanism("all joints", dim=3)
    for k, (build, *_) in enumerate(CASES.values()):
        build(Rig(m, f"c{k}_", grounded=k % 2 == 1))
    back = load(save(m, tmp_path / f"joints{suffix}"))
    one, other = assemble(m), assemble(back)
    assert one.topology == other.topology and hash(one.topology) == hash(other.topology)
    for leaf in ("points", "vectors", "markers", "dimensions"):
        np.testing.assert_array_equal(getattr(one.parameters, leaf), getattr(other.parameters, leaf))


def test_degrees_of_a_screw_are_converted():
    found = sweep_arguments(everything())
    np.testing.assert_allclose(found["inputs"]["turn"][-1], 2 * np.pi, rtol=1e-14)
    assert found["rates"] == {"turn": pytest.approx(np.pi / 18)}
    assert found["inputs"]["way2"][-1] == 0.1


BASE = """\
name = "crank"
dim = 3

[ground]
A = [0, 0, 0]

[points]
B = [1, 0, 0]
C = [1, 0, 1]

[ground_vectors]
z = [0, 0, 1]

[vectors]
u = [0, 1, 0]

[bodies]
crank = { points = ["A", "B"], vectors = ["z"] }
rod = { points = ["B", "C"], vectors = ["u"] }

[angles]
phi = { at = "A", to = "B", about = "z" }

[joints]
hinge = { joint = "revolute", axes = ["z", "u"] }
tube = { joint = "cylindrical", line = ["A", "z"], on = "C" }

[run.inputs]
phi = { from = 0, to = 6.28, poses = 37 }
"""
BROKEN = [
    ("plane", "dim = 3", "dim = 2", ["line 5", "ground point 'A'", "2 numbers"]),
    ("two numbers", "C = [1, 0, 1]", "C = [1, 0]", ["line 9", "point 'C'", "3 numbers", "(1.0, 0.0)"]),
    ("zero vector", "u = [0, 1, 0]", "u = [0, 0, 0]", ["line 15", "vector 'u'", "zero vector"]),
    ("name taken", "u = [0, 1, 0]", "B = [0, 1, 0]", ["line 15", "vector 'B'", "taken by a point"]),
    ("unknown vector", 'vectors = ["u"]', 'vectors = ["uu"]', ["line 19", "'rod'", "vector 'uu'", "did you mean 'u'"]),
    ("vectors as text", 'vectors = ["u"]', 'vectors = "u"', ["line 19", "bodies.rod.vectors", "list of names", "'u'"]),
    ("field", "about =", "abuot =", ["line 22", "angles.phi.abuot", "did you mean 'about'"]),
    ("no axis", ', about = "z"', "", ["line 22", "'phi'", "about an axis", "about="]),
    (
        "axis of numbers",
        '"z" }',
        "[0, 0, 1] }",
        ["line 22", "angles.phi.about", "a name in quotes or a list of 2 names"],
    ),
    ("one axis", '["z", "u"]', '["z"]', ["line 25", "joints.hinge.axes", "list of 2 names"]),
    ("axis is a point", '["z", "u"]', '["z", "B"]', ["line 25", "'hinge'", "'B' is a point"]),
    ("no line", 'line = ["A", "z"], ', "", ["line 26", "joints.tube", "'line' is missing"]),
    ("joint type", '"cylindrical"', '"cylinder"', ["line 26", "joints.tube", "did you mean 'cylindrical'"]),
    ("joint in the plane only", '"cylindrical"', '"planar"', ["line 26", "joints.tube.line", "known names", "plane"]),
    (
        "output",
        "[run.inputs]",
        '[run]\noutputs = ["uu"]\n[run.inputs]',
        ["line 29", "no point, vector, marker or coordinate 'uu'", "did you mean 'u'"],
    ),
    ("input", "phi = { from", "phy = { from", ["line 29", "'phy'", "did you mean 'phi'"]),
    ("input with a dot", "phi = { from", "C.z = { from = 0, to = 1 }\nphi = { from", ["line 29", '"C.z"', "quotes"]),
    (
        "marker",
        "[joints]",
        '[markers]\nk = { on = "rod", at = [0, 0, 0], direction = [0, 0, 1] }\n[joints]',
        ["line 25", "marker 'k'", "at=", "direction="],
    ),
]


@pytest.mark.parametrize(("old", "new", "says"), [pytest.param(*case[1:], id=case[0]) for case in BROKEN])
def test_broken_toml(tmp_path, old, new, says):
    assert BASE.count(old) >= 1
    path = tmp_path / "model.toml"
    path.write_text(BASE.replace(old, new, 1))
    message = refusal(path)
    assert all(piece in message for piece in says), message


def test_a_complaint_of_the_compiler_finds_its_line(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(BASE)
    with pytest.raises(Exception, match="does not share the axis") as caught:
        assemble(load(path))
    error = blame(path, caught.value)
    assert isinstance(error, ModelFileError) and "m.toml, line 26: cylindrical joint 'tube'" in str(error)
