"""Batches written chunk by chunk: the numbers of one solve, in memory that does not grow, through interruptions."""

import json
import zipfile

import numpy as np
import pytest
from mechanisms import reference, slider_crank
from processes import child, ended

import jaxnc as nc
from jaxnc.io.tables import load_npz
from jaxnc.io.target import read_archive

CHUNK = 8
ROUNDING = 1e-13  # of lengths of some decimetres, beside the end of the stroke
D = reference("slidercrank_planar")["definition"]
X = D["conrod"] + D["crank"] * np.linspace(-0.9, 1.6, 21)  # the last of them are out of reach
LARGEST_GROWTH = 10e6  # bytes by which memory may grow while twenty times as much is written; the arrays are 3 × that


def stream(path, inputs=None, **options):
    inputs = {"S.x": X} if inputs is None else inputs
    return nc.stream(slider_crank(), inputs, path, chunk=CHUNK, **{"progress": False, **options})


def pieces(*sizes, stop=None):
    """The same inputs in pieces, until someone interrupts."""
    ends = np.cumsum(sizes)
    for begin, end in zip(ends - sizes, ends, strict=True):
        if stop is not None and end > stop:
            raise KeyboardInterrupt
        yield {"S.x": X[begin:end]}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("stream") / "new" / "whole.npz"
    return stream(path, rates={"S.x": 2.0})


def test_the_file_is_the_solution(whole):
    one = nc.solve_position(slider_crank(), {"S.x": X}, rates={"S.x": 2.0})
    good = np.asarray(one.converged)
    assert 0 < good.sum() < len(X)
    for table in (load_npz(whole.path), whole.table()):
        assert table.name == "slider-crank" and table.driven == ("S.x",)
        assert table.names == ("S.x", "A", "S", "cg", "phi"), "the inputs, and what moves"
        assert table.units["A"] == "m" and table.units["phi"] == "rad"
        np.testing.assert_array_equal(table.status, one.status)
        # Chunks have other neighbours that poses are filled in from: the same to rounding, not to the last bit.
        # Where nothing was found it is the last pose on the branch, which steps end at differently.
        np.testing.assert_allclose(table.residual[good], np.asarray(one.residual)[good], rtol=0, atol=ROUNDING)
        assert np.max(table.residual) < 1e-12 * 0.3, "of the mechanism's size"
        for name in table.names:
            np.testing.assert_allclose(table[name][good], np.asarray(one[name])[good], rtol=0, atol=ROUNDING)
            velocity = np.asarray(one.velocity(name))[good]
            np.testing.assert_allclose(table.velocities[name][good], velocity, rtol=0, atol=100 * ROUNDING)
            assert np.isnan(table[name][~good]).all() and np.isnan(table.accelerations[name][~good]).all()
    assert isinstance(whole.table()["phi"], np.memmap) and whole.table()["phi"].flags.aligned
    assert whole.lanes == 21 and whole.failures == (~good).sum() and whole.resumed == 0
    assert whole.statuses == {nc.Status.CONVERGED: good.sum(), nc.Status.DID_NOT_ASSEMBLE: (~good).sum()}
    assert repr(whole).endswith(f"whole.npz, {(~good).sum()} did not assemble)")
    assert [p.name for p in whole.path.parent.iterdir()] == ["whole.npz"]
    with np.load(whole.path) as plain:
        np.testing.assert_array_equal(plain["status"], one.status)
    assert zipfile.ZipFile(whole.path).testzip() is None


def test_inputs_may_come_from_anywhere(whole, tmp_path):
    np.save(tmp_path / "x.npy", X)
    from_file = {"S.x": np.load(tmp_path / "x.npy", mmap_mode="r")}
    for inputs in (from_file, pieces(1, 0, 11, 9), [{"S.x": X.tolist()}], {"S.x": X[::-1]}):
        got = stream(tmp_path / "p.npz", inputs, rates={"S.x": 2.0}).table()
        want = whole.table()
        for name in want.names:
            turned = slice(None, None, -1) if isinstance(inputs, dict) and inputs is not from_file else slice(None)
            np.testing.assert_array_equal(got[name], want[name][turned])
            np.testing.assert_array_equal(got.velocities[name], want.velocities[name][turned])


def test_pieces_may_come_in_the_same_memory(whole, tmp_path):
    memory = np.empty(6)

    def pieces():
        for begin in range(0, 21, 6):
            piece = X[begin : begin + 6]
            memory[: len(piece)] = piece
            yield {"S.x": memory[: len(piece)]}

    got = stream(tmp_path / "p.npz", pieces(), rates={"S.x": 2.0}).table()
    np.testing.assert_array_equal(got["S"], whole.table()["S"])


def test_chunks_that_the_host_and_compiled_code_solve(tmp_path):
    """The first chunks are the host's; who asks again is compiled for, and the table must not see it."""
    linkage = nc.synthesis.FourBar((0, 0), (2, 0.7), (3, 1), (2, 0)).system
    turn = np.radians(np.linspace(0, 80, 3001))  # with a dead point at 73.2 degrees
    done = nc.stream(linkage, {"phi": turn}, tmp_path / "t.npz", chunk=600, progress=False)
    table, want = done.table(), nc.solve_position(linkage, {"phi": turn})
    assert 0 < done.failures < 3001 and done.failures == (table.status != 0).sum()
    np.testing.assert_array_equal(table.status, want.status)
    np.testing.assert_allclose(table["phi"], np.where(want.converged, turn, np.nan), atol=1e-12)


@pytest.mark.parametrize("inside", [False, True], ids=["whole", "in pieces"])
def test_angles_in_degrees(tmp_path, inside):
    """Inputs, their rates and a start by name; what is written is in radians, and lengths are left alone."""
    system, angles = slider_crank(), np.linspace(20.0, 50.0, 12)
    given = {"unit": "deg", "start": {"phi": 20.0}, "rates": {"phi": 180.0}}
    inputs = [{"phi": angles[:5]}, {"phi": angles[5:]}] if inside else {"phi": angles}
    table = stream(tmp_path / "p.npz", inputs, **given).table()
    wanted = nc.solve_position(
        system, {"phi": np.radians(angles)}, rates={"phi": np.pi}, start={"phi": np.radians(20.0)}
    )
    np.testing.assert_allclose(table["phi"], np.radians(angles), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(table["S"], np.asarray(wanted["S"]), rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(table.velocities["S"], np.asarray(wanted.velocity("S")), rtol=0, atol=100 * ROUNDING)
    with pytest.raises(nc.InputError, match="unit='grad'"):
        stream(tmp_path / "q.npz", inputs, unit="grad")


def test_chosen_quantities_and_rates_that_vary(whole, tmp_path):
    rates = {"S.x": np.linspace(0.0, 2.0, 21)}
    table = stream(tmp_path / "p.npz", rates=rates, accelerations={"S.x": 1.0}, quantities=["cg"]).table()
    assert table.names == ("S.x", "cg")
    want = whole.table().velocities["cg"] * rates["S.x"][:, None] / 2.0
    np.testing.assert_allclose(table.velocities["cg"], want, rtol=1e-13, atol=1e-14)
    np.testing.assert_array_equal(np.unique(table.accelerations["S.x"][table.status == 0]), [1.0])


def test_an_interrupted_call_goes_on(whole, tmp_path):
    path = tmp_path / "p.npz"
    with pytest.raises(KeyboardInterrupt):
        stream(path, pieces(8, 8, 5, stop=16), rates={"S.x": 2.0})
    assert [p.name for p in tmp_path.iterdir()] == ["p.npz.part"]
    index = json.loads((tmp_path / "p.npz.part" / "index.json").read_text())
    assert index["rows"] == 8, "the chunk that was being solved is lost, the one before is not"
    with (tmp_path / "p.npz.part" / "0.bin").open("ab") as file:
        file.write(b"half a chunk")
    with pytest.raises(nc.InputError, match=r"quantities differ.*resume=False"):
        stream(path, rates={"S.x": 2.0}, quantities="A")
    with pytest.raises(nc.InputError, match=r"\(rates differ\)"):
        stream(path)
    with pytest.raises(nc.InputError, match=r"\(design differ\)"):
        other = slider_crank().replace({"crank.O-A": 0.07})
        nc.stream(other, {"S.x": X}, path, rates={"S.x": 2.0}, progress=False)
    with pytest.raises(nc.InputError, match=r"inputs differ.*8 poses.*resume=False"):
        stream(path, {"S.x": X + 1e-3}, rates={"S.x": 2.0})
    with pytest.raises(nc.InputError, match=r"the inputs are fewer than those"):
        stream(path, {"S.x": X[:4]}, rates={"S.x": 2.0})
    done = stream(path, pieces(3, 18), rates={"S.x": 2.0})  # cut otherwise, the same inputs
    assert done.resumed == 8 and done.lanes == 21 and done.statuses == whole.statuses
    assert path.read_bytes() == whole.path.read_bytes()
    assert [p.name for p in tmp_path.iterdir()] == ["p.npz"]


def test_what_is_left_can_be_thrown_away(whole, tmp_path):
    path = tmp_path / "p.npz"
    with pytest.raises(KeyboardInterrupt):
        stream(path, pieces(8, 8, 5, stop=16), rates={"S.x": 2.0})
    (tmp_path / "p.npz.part" / "3.bin").write_bytes(b"")
    with pytest.raises(nc.ModelFileError, match=r"p\.npz\.part.*damaged.*resume=False"):
        stream(path, rates={"S.x": 2.0})
    assert stream(path, rates={"S.x": 2.0}, resume=False).resumed == 0
    assert path.read_bytes() == whole.path.read_bytes()


WRONG = [
    ("mechanism", lambda p: nc.stream(None, {"S.x": X}, p), ["stream() needs a compiled System", "compile()"]),
    ("chunk", lambda p: nc.stream(slider_crank(), {"S.x": X}, p, chunk=0), ["chunk=", "65536", "got 0"]),
    ("input", lambda p: stream(p, {"T.x": X}), ["'T.x'"]),
    ("too many", lambda p: stream(p, {"S.x": X, "phi": X}), ["too many inputs"]),
    ("shape", lambda p: stream(p, {"S.x": X.reshape(3, 7)}), ["S.x: (3, 7)", "one shape (L,)"]),
    ("one number", lambda p: stream(p, {"S.x": 0.2}), ["S.x: ()", "one shape (L,)"]),
    ("words", lambda p: stream(p, {"S.x": ["a"]}), ["input 'S.x' must be a number or an array of numbers"]),
    ("no names", lambda p: stream(p, X), ["the first piece must be arrays by name"]),
    ("a number", lambda p: stream(p, 3), ["an iterable of such mappings", "int"]),
    ("empty", lambda p: stream(p, {"S.x": X[:0]}), ["the inputs are empty"]),
    (
        "names change",
        lambda p: stream(p, [{"S.x": X}, {"b": X}], rates={"S.x": 2.0}),
        ["give S.x by", "piece 1 gives b"],
    ),
    ("quantity", lambda p: stream(p, quantities=["cog"]), ["'cog'", "did you mean 'cg'"]),
    ("rate", lambda p: stream(p, rates={"phi": 1.0}), ["rates: 'phi' is not one of the inputs", "S.x"]),
    ("rate shape", lambda p: stream(p, rates={"S.x": X[:3]}), ["rates of 'S.x' has shape (3,)", "shape (21,)"]),
    ("rate pieces", lambda p: stream(p, [{"S.x": X}], rates={"S.x": X}), ["a number, as the inputs come in pieces"]),
    ("no rates", lambda p: stream(p, accelerations={"S.x": 1.0}), ["accelerations follow from rates"]),
    (
        "nan",
        lambda p: stream(p, {"S.x": np.where(np.arange(21) == 9, np.nan, X)}),
        ["poses 8 to 15", "'S.x': 1 of 8 values"],
    ),
    ("devices", lambda p: stream(p, devices=99), ["devices=99"]),
]


@pytest.mark.parametrize(("call", "parts"), [pytest.param(*case[1:], id=case[0]) for case in WRONG])
def test_batches_that_cannot_be_streamed(call, parts, tmp_path):
    with pytest.raises(nc.InputError) as caught:
        call(tmp_path / "p.npz")
    assert all(part in str(caught.value) for part in parts), str(caught.value)
    assert not (tmp_path / "p.npz").exists()


def test_files_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(nc.OutputError, match=r"file/p\.npz.*another folder"):
        stream(tmp_path / "file" / "p.npz")


def test_mapped_reads_what_numpy_writes(tmp_path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "f": np.asfortranarray(np.arange(6.0).reshape(2, 3)), "n": np.zeros(0)}
    arrays |= {"words": np.array(["x", "yz"]), "one": np.array(3.5)}
    for write, kind in ((np.savez, np.memmap), (np.savez_compressed, np.ndarray)):
        write(tmp_path / "p.npz", **arrays)
        got = read_archive(tmp_path / "p.npz", "an archive", mmap=True)
        assert list(got) == list(arrays) and type(got["a"]) is kind
        for name, array in arrays.items():
            np.testing.assert_array_equal(got[name], array)
    (tmp_path / "cut.npz").write_bytes((tmp_path / "p.npz").read_bytes()[:-30])
    for mmap in (False, True):
        with pytest.raises(nc.ModelFileError, match=r"cut\.npz is not a table"):
            load_npz(tmp_path / "cut.npz", mmap=mmap)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_batch(tmp_path):
    found = json.loads(ended(child("long_stream", str(tmp_path)))[0].splitlines()[-1])
    assert found["lanes"][1] == 20 * found["lanes"][0]
    assert found["bytes"][1] > 3 * LARGEST_GROWTH, "or else this test would see nothing"
    assert found["growth"] < LARGEST_GROWTH, f"{found['growth'] / 1e6:.1f} MB"
    assert found["opened"] < LARGEST_GROWTH, "a mapped table is not read"


def test_a_bar_is_shown_on_request(tmp_path, capsys):
    stream(tmp_path / "p.npz", rates={"S.x": 2.0}, progress=True)
    out, err = capsys.readouterr()
    assert out == "" and "slider-crank: 100%" in err and "21.0/21.0" in err


def test_no_bar_is_shown_where_nobody_watches(tmp_path, capsys):
    stream(tmp_path / "p.npz", progress=None)
    assert capsys.readouterr().err == ""
