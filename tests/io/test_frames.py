"""Motions as data frames and data sets, tables read back, and names that are no file names."""

import csv
import sys

import numpy as np
import pytest
from places import EXAMPLES

import jaxnc as nc
from jaxnc.cli.main import main
from jaxnc.io.target import stem

pandas, xarray = pytest.importorskip("pandas"), pytest.importorskip("xarray")
MODEL = EXAMPLES / "four_bar.toml"
ROUNDING = 1e-14  # a few roundings of an angle that was written in degrees


@pytest.fixture(scope="module")
def swept():
    return nc.sweep(nc.load(MODEL).compile(), {"phi": np.linspace(0.6, 0.9, 4)}, rates={"phi": 1.5})


def test_a_frame_is_the_table_with_units_beside_it(swept, tmp_path):
    frame = swept.to_frame(unit="deg")
    header, *lines = csv.reader(swept.to_csv(tmp_path / "m.csv", unit="deg").read_text().splitlines())
    assert frame.index.name == "pose" and len(frame) == len(lines) == 4
    units = frame.attrs["units"]
    assert ["pose", *(f"{c} [{units[c]}]" if c in units else c for c in frame.columns)] == header
    assert frame.attrs["driven"] == ["phi"] and units["v(phi)"] == "deg/s" and units["P.x"] == "m"
    for k, line in enumerate(lines):
        assert [float(x) for x in line[1:-2]] == frame.iloc[k, : len(line) - 3].tolist()
    np.testing.assert_array_equal(frame["P.x"], swept["P"][:, 0])
    np.testing.assert_array_equal(frame["a(P.y)"], swept.acceleration("P")[:, 1])
    np.testing.assert_allclose(frame["phi"], np.degrees([0.6, 0.7, 0.8, 0.9]), rtol=ROUNDING)
    few = list(swept.to_frame("P"))
    assert few[:6] == ["phi", "P.x", "P.y", "v(phi)", "v(P.x)", "v(P.y)"] and few[-2:] == ["status", "residual"]


def test_a_data_set_has_points_and_axes(swept):
    data = swept.to_xarray(unit="rad")
    assert data.position.dims == ("pose", "point", "axis") and data.position.attrs["units"] == "m"
    assert data.velocity.attrs["units"] == "m/s" and data["v(psi)"].attrs["units"] == "rad/s"
    np.testing.assert_array_equal(data.position.sel(point="P", axis="x"), swept["P"][:, 0])
    np.testing.assert_array_equal(data.acceleration.sel(point="C"), swept.acceleration("C"))
    np.testing.assert_array_equal(data.psi, swept["psi"])
    np.testing.assert_allclose(data.swap_dims(pose="phi").position.sel(phi=0.75, method="nearest").phi, 0.7, atol=0.11)
    assert data.phi.dims == ("pose",) and "phi" in data.coords and data.attrs["driven"] == "phi"
    assert data.status.attrs["flag_meanings"].split()[:2] == ["converged", "did_not_assemble"]


def test_one_pose_lanes_space_and_names_that_are_taken(swept):
    one = swept.pose(1)
    assert one.to_xarray().position.dims == ("point", "axis") and len(one.to_frame()) == 1
    lanes = nc.solve_position(swept.system, {"phi": np.linspace(0.5, 0.8, 6).reshape(2, 3)})
    assert lanes.to_frame().index.names == ["lane", "pose"] and lanes.to_frame()["phi"].iloc[-1] == np.degrees(0.8)
    assert dict(lanes.to_xarray().sizes) == {"lane": 2, "pose": 3, "point": 3, "axis": 2}
    m = nc.Mechanism()
    m.ground("A", (0, 0)), m.point("B", (1, 0)), m.body("arm", ["A", "B"]), m.angle("status", at="A", to="B")
    motion = nc.sweep(m.compile(), {"status": np.array([0.1, 0.2])})
    frame, taken = motion.to_frame(unit="rad"), motion.to_xarray()
    assert frame["status_"].tolist() == [0.1, 0.2] and frame["status"].tolist() == ["converged"] * 2
    assert frame.attrs["units"]["status_"] == "rad" and "status" not in frame.attrs["units"]
    np.testing.assert_allclose(taken["status_"], [0.1, 0.2])
    assert set(taken.status.values) == {0}
    joint = nc.library.cardan_joint()
    (phi,) = joint.model.run.inputs
    space = nc.sweep(joint.compile(), {phi: np.array([0.1, 0.2])})
    data = space.to_xarray()
    (vector,) = data.vector.values[:1]
    assert data.direction.dims == ("pose", "vector", "axis") and list(data.axis.values) == ["x", "y", "z"]
    np.testing.assert_array_equal(data.direction.sel(vector=vector), space[vector])


def test_a_simulation_has_time_and_energies():
    m = nc.Mechanism()
    m.ground("A", (0, 0)), m.point("B", (1, 0))
    m.body("rod", ["A", "B"], mass=2.0, shape="rod")
    m.gravity = (0, -9.81)
    run = nc.simulate(m.compile(), np.linspace(0, 0.4, 5))
    frame, data = run.to_frame(), run.to_xarray()
    total = frame["kinetic energy"] + frame["potential energy"]
    np.testing.assert_allclose(total, total[0], atol=1e-8)
    np.testing.assert_allclose(
        frame["potential energy"], 2.0 * 9.81 * frame["B.y"] / 2, atol=1e-12
    )  # m g h of the middle
    assert frame.attrs["units"]["kinetic energy"] == "J" and frame["time"].tolist() == data.time.values.tolist()
    assert data.time.attrs == {"units": "s"} and data["kinetic energy"].attrs["units"] == "J"


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_table_is_read_back(swept, tmp_path, unit):
    lanes = nc.solve_position(swept.system, {"phi": np.linspace(0.5, 0.8, 6).reshape(2, 3)})
    for motion in (swept, lanes):
        table = nc.io.load_csv(motion.to_csv(tmp_path / "four.csv", unit=unit))
        assert table.name == "four" and table.units["P"] == "m" and table.units["psi"] == "rad"
        np.testing.assert_array_equal(table["P"], motion["P"])
        np.testing.assert_array_equal(table.status, motion.status)
        np.testing.assert_allclose(table["psi"], motion["psi"], rtol=ROUNDING)
        if motion is swept:
            np.testing.assert_array_equal(table.velocities["P"], motion.velocity("P"))
            np.testing.assert_allclose(table.accelerations["psi"], motion.acceleration("psi"), rtol=ROUNDING)


def test_lines_stand_where_their_numbers_say(tmp_path):
    """A table that a spreadsheet has sorted by a column is read as it was."""
    (tmp_path / "t.csv").write_text(
        "lane,pose,P.x [m],P.y [m],status\n1,1,4,8,singular\n0,1,2,6,converged\n1,0,3,7,converged\n0,0,1,5,converged\n"
    )
    table = nc.io.load_csv(tmp_path / "t.csv")
    np.testing.assert_array_equal(table["P"], [[[1, 5], [2, 6]], [[3, 7], [4, 8]]])
    np.testing.assert_array_equal(table.status, [[0, 0], [0, nc.Status.SINGULAR]])


SPREADSHEETS = [
    "pose;phi [deg];P.x [m];P.y [m];status\r\n0;90;1,5;2,5;converged\r\n1;180;-1,5e1;;singular\r\n",
    "\ufeffpose\tphi [°]\tP.x [m]\tP.y [m]\tstatus\n0\t90\t1.5\t2.5\tconverged\n1\t180\t-15\t\tsingular\n\n\t\t\t\t\n",
    'pose , phi [deg], "P.x [m]",P.y [m] ,status\n\n0,90, 1.5,2.5,converged\n1,180,-15,,singular\n',
]


@pytest.mark.parametrize("text", SPREADSHEETS)
def test_what_a_spreadsheet_made_of_a_table_is_read(tmp_path, text):
    """Semicolons and decimal commas, tabs, signs for degrees, blanks and blank lines."""
    (tmp_path / "t.csv").write_text(text, encoding="utf-8", newline="")
    table = nc.io.load_csv(tmp_path / "t.csv")
    np.testing.assert_array_equal(table["P"], [[1.5, 2.5], [-15, np.nan]])
    np.testing.assert_allclose(table["phi"], [np.pi / 2, np.pi], rtol=ROUNDING)
    assert repr(table) == "t: 2 poses, 1 of them failed; phi [rad], P [m]"
    (tmp_path / "t.csv").write_text(text.replace("180", "18o"), encoding="utf-8", newline="")
    line = 1 + next(k for k, words in enumerate(text.splitlines()) if "180" in words)
    with pytest.raises(nc.ModelFileError, match=rf"line {line}.*'phi.*'18o'.*number"):
        nc.io.load_csv(tmp_path / "t.csv")


BAD = [
    ("P.x,P.y\n1,2\n", r"column 'P.x'; write a name and its unit, as in 'P.x \[m\]'"),
    ("pose,P.x [m]\n0,1\n1\n", r"line 3: 1 cells, and the header has 2"),
    ("pose,P.x [m]\n0,1\n1,one\n", r"line 3, column 'P.x \[m\]': 'one' is not a number"),
    ("pose,P.x [m],status\n0,1,sigular\n", r"status 'sigular'; did you mean 'singular'"),
    ("pose,P.x [m],P.x [m]\n0,1,2\n", r"column 'P.x \[m\]' is there twice"),
    ("pose,v(P.x) [m]\n0,1\n", r"the unit of v\(…\) ends in /s"),
    ("lane,pose,P.x [m]\n0,0,1\n0,1,1\n1,0,1\n", r"3 lines are no whole batch of 2 × 2 poses"),
    ("pose,P.x [m]\n1,1\n1,2\n", r"2 lines are no whole batch of 2 poses"),
    ("pose,P.x [m]\n0,1\n0.5,2\n", r"2 lines are no whole batch of 1 poses"),
    ("pose,P.x [m]\n0,1\n,2\n", r"2 lines are no whole batch of 1 poses"),
    ("pose,P.x [m]\ninf,1\n", r"1 lines are no whole batch of"),
    ("P.x [m],P.y [mm]\n1,2\n", r"column 'P.y \[mm\]': write 'P' in one unit, here m"),
    ("P.x [m],v(P.x) [mm/s]\n1,2\n", r"column 'v\(P.x\) \[mm/s\]': write 'P' in one unit, here m"),
    ("time [min],P.x [m]\n1,2\n", r"column 'time \[min\]': write 'time' in one unit, here s"),
    ("", r"is not a table in CSV"),
]


@pytest.mark.parametrize(("text", "says"), BAD)
def test_tables_that_are_none(tmp_path, text, says):
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(nc.ModelFileError, match=r"t\.csv.*" + says):
        nc.io.load_csv(tmp_path / "t.csv")


@pytest.mark.parametrize(("package", "ask"), [("pandas", "to_frame"), ("xarray", "to_xarray")])
def test_what_is_not_installed_is_named(swept, monkeypatch, package, ask):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(nc.JaxncError, match=rf"{ask}.*{package}.*jaxnc\[{package}\]"):
        getattr(swept, ask)()


@pytest.mark.parametrize(
    ("name", "file"),
    [
        ("Four-bar 2", "four-bar-2"),
        ("a/b", "a-b"),
        ("..", "mechanism"),
        ("../../etc/passwd", "etc-passwd"),
        ("C:con", "c-con"),
        ("con", "mechanism-con"),
        ("NUL.txt", "mechanism-nul.txt"),
        ("console", "console"),
        ("a\\b\0c\n", "a-b-c"),
        ("Ko\u0308rper Ä", "körper-ä"),
        ("ж" * 300, "ж" * 60),
        ("\ud800x", "x"),
        (" .hidden. ", "hidden"),
    ],
)
def test_any_name_is_a_file_name(name, file, tmp_path):
    assert stem(name) == file
    (tmp_path / (stem(name) + "-acceleration.json")).write_text("")
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("command", ["run", "compare", "report"])
@pytest.mark.parametrize("name", ["../../up/a b", "C:con", "м" * 300])
def test_commands_write_into_their_folder_only(tmp_path, monkeypatch, capsys, command, name):
    home = tmp_path / "home"
    (home / "deep").mkdir(parents=True)
    monkeypatch.chdir(home)
    m = nc.library.four_bar()
    m.model.name = name
    m.save(home / "m.toml")
    out = {"run": ["--out", "deep", "--no-pictures"], "compare": ["--out", "deep", "--no-pictures"]}
    families = ["--families", "natural"] if command == "compare" else []
    assert main([command, "m.toml", *out.get(command, []), *families, "--no-cache"]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["home"]
    written = {p.name for p in home.iterdir()} - {"deep", "m.toml"}
    assert len(written) == (command == "report") and all(f.endswith("-report.html") for f in written)
    assert len(list((home / "deep").iterdir())) == {"run": 2, "compare": 3}.get(command, 0)
