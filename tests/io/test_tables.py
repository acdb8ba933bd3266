"""Tables: CSV for people, npz for programs."""

import csv
import dataclasses
from pathlib import Path
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import EXAMPLES

from jaxnc.errors import InputError, MechanismError, ModelFileError, OutputError
from jaxnc.io.files import load
from jaxnc.io.tables import load_csv, load_npz, to_csv, to_npz
from jaxnc.kinematics.position import motion, solve_position, sweep
from jaxnc.library.suspensions import macpherson
from jaxnc.mechanism import Mechanism
from jaxnc.status import Status
from jaxnc.synthesis.function import FunctionGeneration

MODEL = EXAMPLES / "four_bar.toml"
POSES = 5


@pytest.fixture(scope="module")
def system():
    return load(MODEL).compile()


@pytest.fixture(scope="module")
def swept(system):
    return sweep(system, {"phi": np.linspace(0.0, 1.0, POSES)}, rates={"phi": 2.0})


@pytest.fixture(scope="module")
def failed(swept):
    """The same with a pose that was not found, and one not reached."""
    status = jnp.array([0, 0, 0, int(Status.SINGULAR), int(Status.NOT_REACHED)])
    return dataclasses.replace(swept, status=status)


def test_a_unit_is_that_of_an_angle_a_direction_or_a_length(system):
    """Components of vectors are plain numbers, also as what a function problem is to generate: it said millimetres."""
    strut = macpherson().compile()
    names = ("s", "6.z", "6", "contact", "v2", "v2.x")
    assert [strut.topology.unit(name) for name in names] == ["mm"] * 4 + ["1"] * 2
    assert [system.topology.unit(name) for name in ("phi", "B.x")] == ["rad", system.topology.length_unit]
    told = [FunctionGeneration.unit.fget(SimpleNamespace(system=strut, output=name)) for name in ("v2.x", "6.z", "toe")]
    assert told == ["1", "mm", "rad"]


def rows(path: Path) -> list[list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_csv_columns_and_numbers(swept, tmp_path):
    path = swept.to_csv(tmp_path / "deep" / "er" / "p.csv")
    assert path == tmp_path / "deep" / "er" / "p.csv"
    header, *lines = rows(path)
    names = ["phi [deg]", "B.x [m]", "B.y [m]", "C.x [m]", "C.y [m]", "P.x [m]", "P.y [m]", "psi [deg]"]

    def per(letter: str, unit: str) -> list[str]:
        return [f"{letter}({n.split()[0]}) [{n.split()[1][1:-1]}{unit}]" for n in names]

    assert header == ["pose", *names, *per("v", "/s"), *per("a", "/s^2"), "status", "residual [m]"]
    assert len(lines) == POSES
    for i, line in enumerate(lines):
        row = dict(zip(header, line, strict=True))
        assert row["pose"] == str(i) and row["status"] == "converged"
        assert float(row["P.y [m]"]) == float(swept["P"][i, 1])  # every bit
        assert float(row["v(P.x) [m/s]"]) == float(swept.velocity("P")[i, 0])
        assert float(row["phi [deg]"]) == np.rad2deg(float(swept["phi"][i]))
        assert float(row["a(psi) [deg/s^2]"]) == np.rad2deg(float(swept.acceleration("psi")[i]))
        assert float(row["residual [m]"]) == float(swept.residual[i]) < 1e-12


def test_csv_of_chosen_names(swept, tmp_path):
    header = rows(to_csv(swept, tmp_path / "p.csv", ["P.x", "D", "phi"]))[0]
    assert header[:5] == ["pose", "phi [deg]", "P.x [m]", "D.x [m]", "D.y [m]"]
    assert rows(to_csv(swept, tmp_path / "p.csv", "psi"))[0][:3] == ["pose", "phi [deg]", "psi [deg]"]
    with pytest.raises(InputError, match=r"'psy'.*did you mean 'psi'"):
        to_csv(swept, tmp_path / "p.csv", ["psy"])


def test_csv_of_failed_poses_has_only_inputs(failed, tmp_path):
    header, *lines = rows(to_csv(failed, tmp_path / "p.csv"))
    assert [line[-2] for line in lines] == ["converged"] * 3 + ["singular", "not_reached"]
    for i, line in enumerate(lines):
        numbers = [*line[2:-2], line[-1]]
        assert line[0] == str(i)
        assert float(line[1]) == pytest.approx(np.rad2deg(failed.inputs["phi"][i])), "the input asked for, always"
        assert all(numbers) if i < 3 else not any(numbers), header


def test_csv_of_one_pose_of_a_batch_and_of_a_motion_in_time(system, swept, tmp_path):
    one = solve_position(system, {"phi": 0.25})
    assert len(rows(to_csv(one, tmp_path / "p.csv"))) == 2
    batch = {name: getattr(swept, name) for name in ("poses", "rates", "asked", "status", "residual")}
    both = dataclasses.replace(swept, **jax.tree.map(lambda x: jnp.stack([x, x]), batch))
    header, *lines = rows(to_csv(both, tmp_path / "p.csv"))
    assert header[:3] == ["lane", "pose", "phi [deg]"]
    assert [line[:2] for line in lines] == [[str(k), str(i)] for k in range(2) for i in range(POSES)]
    timed = motion(system, {"phi": lambda t: 2 * t}, np.linspace(0.0, 0.5, POSES))
    header, *lines = rows(to_csv(timed, tmp_path / "p.csv"))
    assert header[:3] == ["pose", "time [s]", "phi [deg]"]
    assert [float(line[1]) for line in lines] == np.linspace(0.0, 0.5, POSES).tolist()
    assert load_npz(to_npz(timed, tmp_path / "p.npz")).time.tolist() == np.linspace(0.0, 0.5, POSES).tolist()


def test_npz_there_and_back(swept, tmp_path):
    table = load_npz(swept.to_npz(tmp_path / "new" / "p.npz"))
    assert table.name == "four-bar" and table.driven == ("phi",)
    assert table.names == tuple(table) == ("A", "D", "B", "C", "P", "phi", "psi")
    assert "phi" in table and "chi" not in table
    assert table.units["P"] == "m" and table.units["psi"] == "rad"
    np.testing.assert_array_equal(table["P"], swept["P"])
    np.testing.assert_array_equal(table.velocities["P"], swept.velocity("P"))
    np.testing.assert_array_equal(table.accelerations["psi"], swept.acceleration("psi"))
    np.testing.assert_array_equal(table.status, swept.status)
    np.testing.assert_array_equal(table.conditioning, swept.conditioning)
    assert table.jerks == {} and table.time is None
    with pytest.raises(InputError, match=r"'four-bar' has no 'Q'; known names: A, B"):
        table["Q"]


def test_npz_of_failed_poses_is_nan(failed, tmp_path):
    table = load_npz(to_npz(failed, tmp_path / "p.npz"))
    for array in (table["P"], table["phi"], table.velocities["C"]):
        assert np.isfinite(array[:3]).all() and np.isnan(array[3:]).all()
    assert table.status.tolist() == [0, 0, 0, 2, 4]


def test_a_batch_of_designs_is_not_a_table(swept, tmp_path):
    batch = jax.tree.map(lambda x: jnp.stack([x, x]), swept)
    for write in (to_csv, to_npz):
        with pytest.raises(InputError, match=r"batch.*take one.*jax\.tree\.map"):
            write(batch, tmp_path / "p")


@pytest.mark.parametrize("write", [to_csv, to_npz])
def test_tables_that_cannot_be_written(swept, tmp_path, write):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/p.*is a file.*another folder"):
        write(swept, tmp_path / "file" / "p")
    with pytest.raises(OutputError, match=r"folder of that name.*another"):
        write(swept, tmp_path)


def test_tables_that_cannot_be_read(swept, tmp_path):
    with pytest.raises(ModelFileError, match=r"none\.npz cannot be read \(No such file"):
        load_npz(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("pose, phi")
    with pytest.raises(ModelFileError, match=r"text\.npz.*to_npz.*write it again"):
        load_npz(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(ModelFileError, match=r"other\.npz.*to_npz"):
        load_npz(tmp_path / "other.npz")
    np.save(tmp_path / "array.npy", np.zeros(3))
    with pytest.raises(ModelFileError, match=r"array\.npy is not a table"):
        load_npz(tmp_path / "array.npy")
    whole = to_npz(swept, tmp_path / "cut.npz").read_bytes()
    (tmp_path / "cut.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ModelFileError, match=r"cut\.npz.*to_npz"):
        load_npz(tmp_path / "cut.npz")


SEEN_OR_NOT = ["\u00a0B", "B\u00a0", "B\u2009C", "\ufeffB", "B\u200b", "B\x0cC", "B\x1c", "B\x85C", "B\u2028C", "B\x00"]


@pytest.mark.parametrize("name", SEEN_OR_NOT)
def test_names_that_a_table_would_lose_are_refused_when_they_are_given(name):
    m = Mechanism("pendulum")
    m.ground("O", (0, 0))
    with pytest.raises(MechanismError, match="letters that can be seen"):
        m.point(name, (1, 0))
    m.point("B", (1, 0))
    with pytest.raises(MechanismError, match="letters that can be seen"):
        m.body(name, ["O", "B"])
    with pytest.raises(MechanismError, match="do not begin or end with a space"):
        m.body(" bar", ["O", "B"])


@pytest.mark.parametrize("name", ["lane", "lanes", "pose", "status", "v", "φ'", "a/b", "a:b", "#1", "time", "Gelenk_ß"])
def test_names_come_back_from_a_table_as_they_were(tmp_path, name):
    m = Mechanism("pendulum")
    m.ground("O", (0, 0))
    m.point(name, (1, 0))
    m.body("bar", ["O", name])
    m.angle("phi", at="O", to=name)
    found = sweep(m.compile(), {"phi": np.linspace(0.0, 1.0, POSES)}, rates={"phi": 2.0})
    again = load_csv(found.to_csv(tmp_path / "table.csv"))
    assert again.names == ("phi", name)
    np.testing.assert_allclose(again[name], found[name], atol=1e-15)
    np.testing.assert_allclose(again.velocities[name], found.velocity(name), atol=1e-15)


def test_a_coordinate_called_as_a_column_of_tables(tmp_path):
    m = Mechanism("slider")
    m.ground("O", (0, 0))
    m.point("P", (1, 0), fixed="y")
    m.distance("time", "O", "P")
    found = sweep(m.compile(), {"time": np.linspace(1.0, 2.0, POSES)})
    with pytest.raises(InputError, match=r"column 'time'.*names="):
        found.to_csv(tmp_path / "table.csv")
    assert load_npz(found.to_npz(tmp_path / "table.npz"))["time"][-1] == 2.0
