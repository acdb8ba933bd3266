"""Model files: what is written is read back exactly, and what cannot be read is explained."""

import json
import math
import tomllib
import traceback
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from places import EXAMPLES

import jaxnc as nc
from jaxnc.constraints import CATALOGUE, Kind, cable
from jaxnc.constraints.kind import norm
from jaxnc.errors import InputError, MechanismError, ModelFileError, OutputError
from jaxnc.io.drives import sweep_arguments
from jaxnc.io.files import blame, json_text, load, save, toml
from jaxnc.library.catalogue import CATALOGUE as LIBRARY
from jaxnc.mechanism import Mechanism
from jaxnc.mechanism import model as record

MODELS = sorted(EXAMPLES.glob("*.toml"))

BASE = """\
name = "four-bar"

[units]
angle = "deg"

[ground]
A = [0, 0]
D = [4, 0]

[points]
B = [0, 1]
C = [3.3, 2.9]

[bodies]
crank = ["A", "B"]
coupler = ["B", "C"]

[bodies.rocker]
points = [
  "C",
  "D",
]
lengths = {C-D = 3.0}

[angles]
phi = {at = "A", to = "B"}

[run.inputs]
phi = {from = 0, to = 360, poses = 37, rate = 360}
"""

OWN = Kind("midpoint", lambda p, v, s, c: [p[0, 0] + p[1, 0] - 2 * p[2, 0]], points=3)


def everything() -> Mechanism:
    """A description that uses every record and every optional field. It need not assemble."""
    m = Mechanism("all of it", description='with "quotes", \\ and é', length_unit="mm", angle_unit="deg")
    for i, name in enumerate("ABCDEFGHIJK"):
        m.point(name, (0.1 * i, i * i / 3))
    m.ground("O", (0, -0.0))
    m.ground("Q", (1e22, 5e-324))
    m.point("y2", (3, 0), fixed="y")
    m.body("crank", ["A", "B"])
    m.body("coupler", ["B", "C", "D"], lengths={("B", "C"): 3.0}, local={"D": (0.1, 0.2)}, form="text")
    m.body("one", ["y2"])
    m.body("odd name, 100 %", ["E", "F"])
    m.body("wheel", ["G", "H"])
    m.body("block", ["I"], along=("A", "B"))
    m.marker("M", on="crank", at=(1 / 3, 2 / 3))
    m.angle("phi", at="A", to="B")
    m.angle("psi", to=("C", "D"), start=("A", "B"), form="sum")
    m.angle("chi", at="O", to="G", start="A")
    m.distance("s", "A", "B", along="C", form="redundant")
    m.distance("s2", "A", "C")
    m.distance("s3", "A", "C", along=("D", "E"))
    m.revolute("pin", "A", "E")
    m.prismatic("guide", ("A", "B"), ("C", "D"), form="text")
    m.slot("slot", "C", ("A", "B"))
    m.gear("ring", "phi", "psi", radii=(1, 2), internal=True)
    m.gear("pair", "phi", "psi")
    m.rolling("roll", "G", "H", "I", ("A", "B"), "turn", "way", radius=0.3, form="text")
    m.cable("rope", ["A", "B", "C"], length=3)
    m.weld("seam", "crank", "coupler")
    m.relation("tie", {"phi": 1, "turn": 2, "A.x": 0.1}, constant=0.25)
    m.relation("two", {"phi": 1, "psi": -2})
    m.constrain("in line", CATALOGUE["aligned"], ["A", "B", "C"])
    m.constrain("long rope", cable(4), ["A", "B", "C", "D"], constants={"length": 9.0})
    drives = {"phi": record.Drive(0.0, 360.0, 37, 10.0), "s": record.Drive(0.0, 0.1, 37)}
    m.model.run = record.Run(inputs=drives, hold=["s2"], analysis="solve_position", outputs=["M", "M.x", "psi", "A.x"])
    return m


# ---------------------------------------------------------------------------------------------------------------
# there and back


@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_everything_comes_back_bit_for_bit(tmp_path, suffix):
    m = everything()
    path = save(m, tmp_path / f"all{suffix}")
    back = load(path)
    assert back.model == m.model
    assert repr(back.model) == repr(m.model)  # also the sign of -0.0 and the order of every table
    assert save(back, tmp_path / f"again{suffix}").read_bytes() == path.read_bytes()


def test_tables_longer_than_a_line_come_back(tmp_path):
    m = nc.library.four_bar()
    m.spring("s", "B", "D", stiffness=1000 / 3, free=np.sqrt(17) * 0.93, preload=-10 / 3, cubic=1e5 / 7)
    angles = {f"an_angle_with_a_long_name_{k}": 1 / (3 + k) for k in range(4)}
    for name in angles:
        m.angle(name, at="A", to="B")
    m.relation("tied", angles)
    path = m.save(tmp_path / "long.toml")
    assert nc.load(path).model == m.model
    assert max(map(len, path.read_text().splitlines())) < 130


@pytest.mark.parametrize("name", LIBRARY)
def test_library_comes_back(tmp_path, name):
    m = LIBRARY[name]()
    m.save(tmp_path / "m.toml")
    m.save(tmp_path / "m.json")
    assert load(tmp_path / "m.toml").model == load(tmp_path / "m.json").model == m.model


@pytest.mark.parametrize("path", MODELS, ids=lambda p: p.stem)
def test_examples_come_back(tmp_path, path):
    m = load(path)
    assert load(save(m, tmp_path / path.name)).model == m.model
    assert m.model.run.inputs and m.model.description


def test_there_are_examples():
    assert {"four_bar", "scissor_lift"} <= {p.stem for p in MODELS}


@settings(deadline=None)
@given(
    st.dictionaries(st.text(st.characters(exclude_categories=["Cs"])), st.floats(allow_nan=False, allow_infinity=False))
)
def test_names_and_numbers_survive_both_layouts(table):
    data = {"name": "x", "lengths": table} if table else {"name": "x"}
    for back in (tomllib.loads(toml(data)), json.loads(json_text(data))):
        back = {k: float(v) for k, v in back.get("lengths", {}).items()}
        assert back == table
        assert all(math.copysign(1, back[k]) == math.copysign(1, table[k]) for k in table)


def test_a_file_reads_pleasantly(tmp_path):
    text = save(everything(), tmp_path / "m.toml").read_text(encoding="utf-8")
    assert "\nB = [0.1, 0.3333333333333333]\n" in text
    assert '\ncrank = ["A", "B"]\n' in text
    assert '\nphi = { at = "A", to = "B" }\n' in text
    assert "\nphi = { from = 0, to = 360, poses = 37, rate = 10 }\n" in text
    assert '\nroll.joint = "rolling"\n' in text  # too long for one line
    assert max(map(len, text.splitlines())) <= 120


def test_load_reads_what_an_editor_of_another_system_wrote(tmp_path):
    path = tmp_path / "m.TOML"
    path.write_bytes(b"\xef\xbb\xbf" + BASE.replace("\n", "\r\n").encode())
    assert load(path).model.bodies["rocker"].lengths == {"C-D": 3.0}


# ---------------------------------------------------------------------------------------------------------------
# the run section


def test_degrees_are_converted_where_the_file_says_so_and_nowhere_else(tmp_path):
    (tmp_path / "m.toml").write_text(BASE)
    m = load(tmp_path / "m.toml")
    assert m.model.run.inputs["phi"].end == 360.0
    found = sweep_arguments(m)
    assert found["hold"] == ()
    np.testing.assert_allclose(found["inputs"]["phi"], np.linspace(0, 2 * np.pi, 37), rtol=1e-14)
    assert found["rates"] == {"phi": pytest.approx(2 * np.pi, rel=1e-14)}
    m.model.units = record.Units()
    assert sweep_arguments(m)["inputs"]["phi"][-1] == 360.0
    all_kinds = everything()
    found = sweep_arguments(all_kinds)
    assert found["inputs"]["s"][-1] == 0.1
    assert found["rates"] == {"phi": pytest.approx(np.pi / 18)}


def test_a_rolling_angle_is_an_angle():
    m = everything()
    m.model.run = record.Run(inputs={"turn": record.Drive(0.0, 180.0, 2)})
    assert sweep_arguments(m)["inputs"]["turn"][1] == pytest.approx(np.pi)
    assert sweep_arguments(m)["rates"] is None


def test_nothing_driven():
    with pytest.raises(InputError, match=r"'idle': nothing is driven; say how"):
        sweep_arguments(Mechanism("idle"))


# ---------------------------------------------------------------------------------------------------------------
# what cannot be read

JOINTS = "[angles]"


def joint(text: str) -> str:
    return f"[joints]\n{text}\n[angles]"


# (what is wrong, text that is replaced, by what, what the message says)
BROKEN = [
    ("syntax", "D = [4, 0]", "D = [4, 0", ["line 10", "column", "not valid TOML"]),
    ("truncated", BASE[BASE.index("lengths") :], "lengths = {C-D = ", ["line 23", "ends too early", "cut short"]),
    ("truncated in a list", BASE[BASE.index('  "D"') :], '  "D"', ["line 21", "ends too early", "cut short"]),
    ("key twice", "D = [4, 0]", "A = [4, 0]", ["line 8", "'A'", "given twice", "keep one"]),
    ("table twice", "[points]", "[ground]", ["line 10", "'ground'", "given twice", "keep one"]),
    ("name twice", "B = [0, 1]", "A = [0, 1]", ["line 11", "point 'A'", "already taken by a ground point", "choose"]),
    ("body twice", "coupler =", 'twin = ["A", "B"]\ncoupler =', ["line 16", "'twin'", "body 'crank'", "remove one"]),
    ("unknown point", '["B", "C"]', '["B", "Cc"]', ["line 16", "'coupler'", "unknown point 'Cc'", "did you mean 'C'"]),
    ("unknown field", "lengths = {C", "lenghts = {C", ["line 23", "bodies.rocker.lenghts", "did you mean 'lengths'"]),
    ("unknown table", "[points]", "[ponits]", ["line 10", "ponits", "unknown table", "did you mean 'points'"]),
    ("text for a number", "C-D = 3.0", 'C-D = "3"', ["line 23", "C-D", "expected a number", "text '3'"]),
    ("bad length key", "C-D = 3.0", "CD = 3", ["line 18", "'rocker'", "'CD'", "with a dash, as in 'B-C'"]),
    ("negative length", "C-D = 3.0", "C-D = -3", ["line 18", "'rocker'", "C-D", "must be positive"]),
    ("NaN", "[4, 0]", "[4, nan]", ["line 8", "ground point 'D'", "finite number", "got nan"]),
    ("infinite rate", "rate = 360", "rate = inf", ["line 29", "'phi'", "rate = inf", "finite"]),
    ("one number", "[4, 0]", "[4]", ["line 8", "ground point 'D'", "2 numbers"]),
    ("text for a place", "[0, 1]", '"0, 1"', ["line 11", "points.B", "expected a list of numbers", "'0, 1'"]),
    ("huge number", "[4, 0]", "[4, 1" + 400 * "0" + "]", ["line 8", "ground.D.1", "too large"]),
    ("too many digits", "[4, 0]", "[4, 1" + 5000 * "0" + "]", ["too many digits"]),
    ("dim", "[units]", "[units]\ndim = 3", ["line 4", "units.dim", "unknown field"]),
    ("four dimensions", "[units]", "dim = 4\n[units]", ["line 3", "dim = 2", "dim = 3", "got 4"]),
    ("unit", '"deg"', '"degrees"', ["line 4", "units.angle", "'degrees'", "did you mean 'deg'"]),
    ("form", 'to = "B"}', 'to = "B", form = "cosinus"}', ["line 26", "angles.phi.form", "did you mean 'cosine'"]),
    ("no direction", ', to = "B"}', "}", ["line 26", "angles.phi", "'to' is missing", "a name in quotes"]),
    ("half a pair", 'to = "B"}', 'to = ["B"]}', ["line 26", "angles.phi.to", "a list of 2 names", "['B']"]),
    ("joint type", JOINTS, joint('s = {joint = "slott", point = "B"}'), ["line 26", "joints.s", "did you mean 'slot'"]),
    ("joint field", JOINTS, joint('s = {joint = "slot", point = "B"}'), ["line 26", "'line' is missing", "2 names"]),
    ("no joint type", JOINTS, joint('s = {point = "B"}'), ["line 26", "'joint' is missing", "'revolute'", "'slot'"]),
    (
        "joint point",
        JOINTS,
        joint('s = {joint = "slot", point = "X", line = ["A", "D"]}'),
        ["line 26", "slot 's'", "unknown point 'X'", "known names: A, B, C, D"],
    ),
    (
        "own kind",
        JOINTS,
        "[constraints]\nq = {kind = 'own'}\n[angles]",
        ["line 26", "'own'", "Python, load(path, kinds="],
    ),
    ("word of another", 'to = "B"}', 'from = "D", to = "B"}', ["line 26", "angles.phi.from", "known names: ", "start"]),
    ("input name", "phi = {from", "phii = {from", ["line 29", "'phii'", "did you mean 'phi'"]),
    ("half a pose", "poses = 37", "poses = 3.5", ["line 29", "run.inputs.phi.poses", "whole number", "3.5"]),
    ("no pose", "poses = 37", "poses = 0", ["line 29", "'phi'", "poses = 0", "at least 1"]),
    ("one pose for a range", "poses = 37", "poses = 1", ["line 29", "'phi'", "poses = 1", "at least 2"]),
    (
        "input with a dot",
        "phi = {from",
        "B.x = {from=0, to=1}\nphi = {from",
        ["line 29", "run.inputs.B", '"B.x"', "quotes"],
    ),
    (
        "uneven poses",
        "phi = {from",
        '"B.x" = {from=0, to=1, poses=2}\nphi = {from',
        ["line 28", "as many poses each", "B.x has 2", "phi has 37"],
    ),
    ("output", "[run.inputs]", "[run]\noutputs = ['Z']\n[run.inputs]", ["line 29", "'Z'", "known names: A, A.x"]),
    ("hold", "[run.inputs]", "[run]\nhold = ['Phi']\n[run.inputs]", ["line 29", "'Phi'", "did you mean 'phi'"]),
    ("analysis", "[run.inputs]", "[run]\nanalysis = 'cirkuit'\n[run.inputs]", ["line 29", "did you mean 'circuit'"]),
    ("a date", "[4, 0]", "2020-01-01", ["line 8", "ground.D", "expected a list of numbers", "2020-01-01"]),
    ("nesting", "[4, 0]", "[" * 5000, ["nested too deeply"]),
    ("empty", BASE, " \n", ["is empty", "ground, points and bodies"]),
    ("zero byte", "name", "\0name", ["line 1", "zero byte"]),
]


def refusal(path: Path, **options) -> str:
    """The message of the error that loading raises, which must not drag anybody else's traceback along."""
    with pytest.raises(ModelFileError) as caught:
        load(path, **options)
    error = caught.value
    assert error.__cause__ is None and (error.__context__ is None or error.__suppress_context__)
    shown = "".join(traceback.format_exception(error))
    assert "During handling" not in shown and "site-packages" not in shown and "/tomllib/" not in shown
    assert path.name in str(error)
    return str(error)


@pytest.mark.parametrize(("old", "new", "says"), [pytest.param(*case[1:], id=case[0]) for case in BROKEN])
def test_broken_toml(tmp_path, old, new, says):
    assert BASE.count(old) >= 1
    path = tmp_path / "model.toml"
    path.write_text(BASE.replace(old, new, 1))
    message = refusal(path)
    assert all(piece in message for piece in says), message


def test_choices_are_listed_once(tmp_path):
    path = tmp_path / "model.toml"
    path.write_text(BASE.replace(JOINTS, joint('s = {joint = "hinge", point = "B"}'), 1))
    assert "'hinge' is not one of" in refusal(path) and refusal(path).count("revolute") == 1


JSON = json.dumps(
    {
        "ground": {"A": [0, 0], "D": [4, 0]},
        "points": {"B": [0, 1]},
        "bodies": {"crank": ["A", "B"], "rod": {"points": ["B", "D"], "lengths": {"B-D": 4.0}}},
    },
    indent=1,
)
BROKEN_JSON = [
    ("truncated", JSON[JSON.index('"lengths') :], '"lengths": {', ["line 28", "ends too early", "cut short"]),
    ("syntax", '"points": {\n  "B"', '"points": {\n  B', ["line 13", "column 3", "not valid JSON"]),
    ("key twice", '"D": [', '"A": [', ["line 7", "'A'", "given twice", "keep one"]),
    ("NaN", "4,", "NaN,", ["line 7", "ground point 'D'", "finite number", "got nan"]),
    ("infinity", "4,", "1e999,", ["line 7", "ground point 'D'", "finite number", "got inf"]),
    (
        "unknown point",
        '"D"\n   ],',
        '"E"\n   ],',
        ["line 23", "body 'rod'", "unknown point 'E'", "known names: A, B, D"],
    ),
    ("text for a number", "4.0", '"4"', ["line 29", "bodies.rod.lengths.B-D", "expected a number"]),
    ("a list", JSON, "[1, 2]", ["expected a table", "[1, 2]"]),
    ("null", "4.0", "null", ["line 29", "expected a number", "nothing"]),
    ("nesting", JSON, "[" * 100_000, ["nested too deeply"]),
]


@pytest.mark.parametrize(("old", "new", "says"), [pytest.param(*case[1:], id=case[0]) for case in BROKEN_JSON])
def test_broken_json(tmp_path, old, new, says):
    assert JSON.count(old) >= 1
    path = tmp_path / "model.json"
    path.write_text(JSON.replace(old, new, 1))
    message = refusal(path)
    assert all(piece in message for piece in says), message


def test_json_model_is_good(tmp_path):
    (tmp_path / "model.json").write_text(JSON)
    assert set(load(tmp_path / "model.json").model.bodies) == {"crank", "rod"}


def test_what_is_no_model_file(tmp_path):
    (tmp_path / "good.toml").write_text(BASE)
    (tmp_path / "junk.toml").write_bytes(b"\x7fELF\x02\x01\xff\xfe\x00")
    assert "UTF-8" in refusal(tmp_path / "junk.toml")
    assert "no such file; did you mean 'good.toml'" in refusal(tmp_path / "god.toml")
    assert "there are no model files in" in refusal(tmp_path / "nowhere" / "m.toml")
    assert "no such file" in refusal(tmp_path / "good.toml" / "m.toml")
    assert "is a folder; name a model file in it" in refusal(tmp_path)
    assert ".toml or .json, this name ends in '.yaml'" in refusal(tmp_path / "m.yaml")


def test_an_unreadable_file(tmp_path, monkeypatch):
    def refuse(self):
        raise PermissionError(13, "Permission denied")

    (tmp_path / "m.toml").write_text(BASE)
    monkeypatch.setattr(Path, "read_bytes", refuse)
    assert "(Permission denied); check its permissions" in refusal(tmp_path / "m.toml")


def test_a_complaint_of_the_compiler_finds_its_line(tmp_path):
    path = tmp_path / "m.toml"
    path.write_text(BASE.replace("B = [0, 1]", "B = [0, 0]"))
    with pytest.raises(MechanismError) as caught:
        load(path).compile()
    error = blame(path, caught.value)
    assert isinstance(error, ModelFileError)
    assert "m.toml, line 15: body 'crank'" in str(error) and "same place" in str(error)
    assert "line" not in str(blame(path, MechanismError("nobody is named")))


# ---------------------------------------------------------------------------------------------------------------
# own kinds, and where nothing can be written


MAGNET = nc.forces.ForceKind("magnet", ("strength",), points=2, potential=lambda p, v, s, c: -c[0] / norm(p[1] - p[0]))


def own_kind() -> Mechanism:
    m = Mechanism("own")
    m.ground("A", (0, 0))
    m.ground("D", (4, 0))
    m.point("B", (2, 1))
    m.constrain("middle", OWN, ["A", "D", "B"])
    return m


def test_own_kinds_are_named_and_given_back(tmp_path):
    m, path = own_kind(), tmp_path / "own.toml"
    with pytest.raises(MechanismError, match=r"'middle'.*kinds=\{'midpoint'") as caught:
        m.save(path)
    assert "load()" in str(caught.value) and not path.exists()
    save(m, path, kinds={"midpoint": OWN})
    message = refusal(path)
    assert "line 11" in message and "'midpoint'" in message and "load(path, kinds={'midpoint': …})" in message
    back = load(path, kinds={"midpoint": OWN})
    assert back.model == m.model and back.kinds == m.kinds


def test_own_kinds_of_forces_are_named_and_given_back(tmp_path):
    m, path = own_kind(), tmp_path / "own.json"
    m.apply("magnet", MAGNET, points=["A", "B"], parameters={"strength": 2.0})
    kinds = {"midpoint": OWN, "magnet": MAGNET}
    with pytest.raises(MechanismError, match=r"force 'magnet'.*kinds=\{'magnet'"):
        save(m, path, kinds={"midpoint": OWN})
    save(m, path, kinds=kinds)
    with pytest.raises(nc.ModelFileError, match=r"force 'magnet': unknown kind 'magnet'.*load\(path, kinds="):
        load(path, kinds={"midpoint": OWN})
    back = load(path, kinds=kinds)
    assert back.model == m.model and back.force_kinds == {"magnet": MAGNET}


def test_a_kind_that_only_borrows_a_name_of_the_catalogue_is_not_saved(tmp_path):
    m = own_kind()
    m.constrain("false friend", Kind("aligned", OWN.residual, points=3), ["A", "D", "B"])
    with pytest.raises(MechanismError, match=r"'false friend'.*own kind 'aligned'"):
        save(m, tmp_path / "m.toml", kinds={"midpoint": OWN})


@pytest.mark.parametrize(
    ("code", "remedy"),
    [(13, "choose another folder"), (28, "free some space"), (30, "read-only"), (5, "check the path")],
)
def test_a_file_that_cannot_be_written(tmp_path, monkeypatch, code, remedy):
    def refuse(self, content):
        raise OSError(code, "No luck")

    monkeypatch.setattr(Path, "write_bytes", refuse)
    with pytest.raises(OutputError) as caught:
        save(everything(), tmp_path / "new" / "m.toml")
    assert str(tmp_path / "new" / "m.toml") in str(caught.value)
    assert "(no luck)" in str(caught.value) and remedy in str(caught.value)
    assert caught.value.__suppress_context__


def test_a_folder_that_is_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file.*is a file.*another folder"):
        save(everything(), tmp_path / "file" / "deeper" / "m.toml")


def test_wrong_suffix_to_save(tmp_path):
    with pytest.raises(MechanismError, match=r"\.toml or \.json.*'\.yaml'"):
        save(everything(), tmp_path / "m.yaml")
