"""Six-bars through eight pairs of angles: equations against moved mechanisms, known paths, and what is refused."""

import dataclasses

import numpy as np
import pytest

import jaxnc as nc
from jaxnc import synthesis as syn
from jaxnc.continuation.monodromy import SAME, is_new
from jaxnc.synthesis.exact import six_bars
from jaxnc.synthesis.exact.bar_paths import MIRRORED
from jaxnc.synthesis.exact.six_bars import AngleStarts, SixBarPaths, draw_bend, draw_linkage, find_angle_starts

MET = 1e-9  # of the size: joints found again, and rows of sizes about one

POINTS = {
    "Watt II": {"A": (0, 0), "B": (2, 0.1), "C": (4, -0.2), "D": (0.3, 1), "E": (1.7, 1.5), "F": (2.5, 1.4),
                "G": (3.6, 1.1)},
    "Stephenson II": {"A": (0, 0), "C": (4, 0.3), "D": (0.3, 1), "E": (-0.6, 1.2), "F": (2, 2.2), "G": (1.5, 3),
                      "H": (3.5, 1.4)},
    "Stephenson III": {"A": (0, 0), "B": (2, 0.1), "C": (4, -0.2), "D": (0.3, 1), "E": (1.7, 1.5), "F": (1.5, 2.4),
                       "G": (3.6, 1.1)},
}  # fmt: skip
BODIES = {
    "Watt II": ("AD", "DE", "BEF", "FG", "CG"),
    "Stephenson II": ("ADE", "DF", "EG", "HFG", "CH"),
    "Stephenson III": ("AD", "DEF", "BE", "FG", "CG"),
}
MIDDLE = {"Watt II": "BE", "Stephenson II": "HF", "Stephenson III": "DE"}  # on the link whose turns are unknown
KINDS = tuple(POINTS)


def move(kind):
    """A linkage that is described here, moved: angles at eight pairs, and the turns of its middle link."""
    m = nc.Mechanism(kind)
    for name, at in POINTS[kind].items():
        (m.ground if name in "ABC" else m.point)(name, at)
    for joints in BODIES[kind]:
        m.body(joints, list(joints))
    m.angle("phi", at="A", to="D")
    start = np.arctan2(*POINTS[kind]["D"][::-1])
    motion = nc.sweep(m.compile(), {"phi": start + np.linspace(0.0, -0.9, 8)})
    motion.check()
    z = {name: np.asarray(motion[name]) @ [1, 1j] for name in POINTS[kind]}
    end, (one, other) = "H" if kind == "Stephenson II" else "G", MIDDLE[kind]
    psi = np.unwrap(np.angle(z[end] - z["C"]))
    turn = (z[other] - z[one]) / (z[other] - z[one])[0]
    return np.linspace(0.0, -0.9, 8), psi - psi[0], turn, {name: at[0] for name, at in z.items()}


def arguments(kind):
    given = POINTS[kind]
    a, c, d = (complex(*given[name]) for name in "ACD")
    own = (
        {"D": given["D"], "length": abs(complex(*given["H"]) - c)}
        if kind == "Stephenson II"
        else {"B": given["B"], "length": abs(d - a)}
    )
    return {"A": given["A"], "C": given["C"], **own}


def unknowns(kind, z):
    """The vectors that are solved for, by the places of the joints."""
    if kind == "Watt II":
        one, two = z["B"] - z["A"], z["B"] - z["C"]
        v = [(z["E"] - z["B"]) / one, (z["F"] - z["B"]) / two, (z["A"] - z["D"]) / one, (z["C"] - z["G"]) / two]
    elif kind == "Stephenson III":
        v = [z["E"] - z["D"], z["F"] - z["D"], z["D"] - z["A"], z["C"] - z["G"]] / (z["A"] - z["B"])
    else:
        v = [z["H"] - z["F"], z["H"] - z["G"], z["E"] - z["A"], z["C"] - z["H"]] / (z["A"] - z["C"])
    v = np.array(v)
    return np.concatenate([v[:2], v[:2].conj(), v[2:], v[2:].conj()])


def task_of(kind, x, y):
    given = arguments(kind)
    length = given.pop("length")
    return six_bars._check_angles(kind, x, y, {"B": None, "D": None} | given, length)[2]


@pytest.mark.parametrize("kind", KINDS)
def test_equations_hold_for_a_moved_mechanism(kind):
    """Its vectors solve them, and the turns that they give are those of its middle link."""
    x, y, turn, z = move(kind)
    task = task_of(kind, x, y)
    paths = SixBarPaths(kind, task, task)
    v = unknowns(kind, z)
    w, _ = paths.polish(v[:, None], steps=1)
    np.testing.assert_allclose(w[:8, 0], v, atol=MET)
    np.testing.assert_allclose(1.0 + w[8:15, 0], turn[1:], atol=MET)
    np.testing.assert_allclose(w[15:, 0], w[8:15, 0].conj(), atol=MET)


@pytest.mark.parametrize("kind", KINDS)
def test_power_series_against_newton(kind):
    """A path's series misses it by the sixth power of the step."""
    z, task = draw_linkage(kind, np.random.default_rng(4))
    end = dataclasses.replace(task, angles=task.angles + 1.0)
    paths, lanes = SixBarPaths(kind, task, end, draw_bend(kind, np.random.default_rng(5))), np.arange(1)
    w = paths.turned(z[:, None], np.zeros(1))
    _, linear, _ = paths.correct(w, np.zeros(1), lanes)
    terms, gaps = paths.series(w, np.zeros(1), lanes, linear), []
    least = min(1.0, *(np.abs(terms[k]).max() ** (-1.0 / (k + 1)) for k in range(5)))  # about what the series reaches
    for h in (0.1 * least, 0.05 * least):
        guess = w + sum(term * h ** (k + 1) for k, term in enumerate(terms))
        exact = guess
        for _ in range(6):
            exact, _, _ = paths.correct(exact, np.full(1, h), lanes)
        gaps.append(np.abs(exact - guess).max())
    assert 32.0 < gaps[0] / gaps[1] < 128.0


def starts_of(kind, route, *others):
    """The start solution whose path ends in a linkage, and some others with theirs; found by going its way back."""
    x, y, _, z = move(kind)
    task = task_of(kind, x, y)
    _, start = draw_linkage(kind, np.random.default_rng(1))
    near = dataclasses.replace(task, angles=start.angles + np.angle(np.exp(1j * (task.angles - start.angles).real)))
    bend = draw_bend(kind, np.random.default_rng([3, route]))
    ends = SixBarPaths(kind, near, start, bend).follow(unknowns(kind, z)[:, None])
    assert ends.arrived.all()
    both = np.concatenate([ends.w[:8], ends.w[MIRRORED].conj()], axis=1)
    return x, y, z, AngleStarts(start, both, 1, 0, 2, True)


@pytest.mark.parametrize("kind", KINDS)
def test_a_known_linkage_is_found_at_the_end_of_its_path(kind, monkeypatch):
    x, y, z, starts = starts_of(kind, 0)
    monkeypatch.setattr(six_bars, "find_angle_starts", lambda kind, show: starts)
    found = syn.precision_six_bars(kind, 0.3 + x, y - 0.1, **arguments(kind))
    assert (found.found, found.missing) == (2, found.expected - 2) and not found.complete
    gaps = [max(abs(complex(*design.points[name]) - at) for name, at in z.items()) for design in found]
    best = found[int(np.argmin(gaps))]
    assert min(gaps) < MET and best.proved and not best.defects and best.error < MET
    motion = nc.sweep(best.system, {"phi": best.inputs})
    np.testing.assert_allclose(np.asarray(motion["psi"]), best.outputs, atol=MET)
    assert best.mechanism().compile().topology.points == best.system.topology.points
    assert str(best).startswith(kind) and "works" in str(found)


def test_paths_that_are_lost_are_counted(monkeypatch):
    kind = "Watt II"
    x, y, _, starts = starts_of(kind, 0)
    follow = SixBarPaths.follow

    def lose_last(self, z, pace):
        out = follow(self, z, pace)
        lost = np.arange(z.shape[1]) == z.shape[1] - 1
        return dataclasses.replace(out, arrived=out.arrived & ~lost, at=np.where(lost, 0.5, out.at))

    monkeypatch.setattr(six_bars, "find_angle_starts", lambda kind, show: starts)
    monkeypatch.setattr(six_bars, "_COUNTS", dict.fromkeys(KINDS, 2))
    monkeypatch.setattr(six_bars, "_ROUTES", 1)  # another way leads elsewhere, where these two are not all
    monkeypatch.setattr(SixBarPaths, "follow", lose_last)
    found = syn.precision_six_bars(kind, x, y, **arguments(kind))
    assert (found.found, found.missing, found.complete) == (1, 1, False)
    assert "at most 1 more" in found.statement


@pytest.mark.parametrize("kind", KINDS)
def test_loops_find_solutions_and_go_on_where_they_were_interrupted(kind, monkeypatch, tmp_path):
    monkeypatch.setenv("JAXNC_CACHE", str(tmp_path))
    monkeypatch.setattr(six_bars, "_DRAWS", 4)
    told = []

    def stop(known, at):
        told.append(known)
        if known >= at:
            raise KeyboardInterrupt

    for at in (7, 15):
        with pytest.raises(KeyboardInterrupt, match="are kept"):
            find_angle_starts(kind, lambda known, at=at: stop(known, at))
    assert told == sorted(set(told))
    (file,) = tmp_path.rglob("*.npz")
    with np.load(file) as kept:
        z = kept["z"]
        task = six_bars.AngleTask(*(kept[name] for name in six_bars.FIELDS))
    assert z.shape[1] == told[-1] and is_new(z[:, :0], z).all()
    # Lengths of bars, from first principles: what q, q' and the turns are at every pair.
    w, last = SixBarPaths(kind, task, task).polish(z, steps=1)
    assert last.max() < MET
    turn, back = (1.0 + part for part in w[8:].reshape(2, 7, -1))
    np.testing.assert_allclose(turn * back, 1.0, atol=MET * np.abs(turn * back).max())
    s, t = np.exp(1j * task.angles)[:, :, None]
    for bar, places in enumerate(
        {"Watt II": ("s", "t"), "Stephenson II": ("gt", "st"), "Stephenson III": ("s", "st")}[kind]
    ):
        ends = []
        for side, (one, two, link) in enumerate(((s, t, turn), (1 / s, 1 / t, back))):
            r = z[4 + 2 * side : 6 + 2 * side]
            parts = {"s": one * r[0], "t": two * r[1], "g": one * task.given[side]}
            ends.append(task.b[bar, side] + sum(parts[p] for p in places) + link * z[2 * side + bar])
        first = [task.b[bar, side] + sum({"s": z[4 + 2 * side], "t": z[5 + 2 * side], "g": task.given[side]}[p]
                 for p in places) + z[2 * side + bar] for side in (0, 1)]  # fmt: skip
        square, size = ends[0] * ends[1], np.abs(z).max(axis=0) ** 2
        assert (np.abs(square - first[0] * first[1]) < MET * size * (1 + np.abs(turn) + np.abs(back))).all()


def test_new_columns_by_comparing_all():
    rng = np.random.default_rng(2)
    known = rng.normal(size=(5, 40)) + 1j * rng.normal(size=(5, 40))
    other = rng.normal(size=(5, 30)) + 1j * rng.normal(size=(5, 30))
    w = np.concatenate([known[:, ::3] + 0.1 * SAME, other, other[:, :7] - 0.1 * SAME, other[:, :5] + 3 * SAME], axis=1)
    expected = []
    for k in range(w.shape[1]):
        before = np.concatenate([known, w[:, [i for i in range(k) if expected[i]]]], axis=1)
        expected.append(not (np.abs(before - w[:, [k]]).max(axis=0) < SAME * max(1.0, np.abs(w[:, k]).max())).any())
    assert is_new(known, w).tolist() == expected and 30 < sum(expected) < 50


X, Y = np.linspace(0.0, 1.0, 8), np.linspace(0.0, 1.0, 8) ** 1.3


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "Watt I"}, "no kind 'Watt I'.*Watt II"),
        ({"inputs": X[:7], "outputs": Y[:7]}, "7 pairs of angles; there must be 8"),
        ({"inputs": np.where(np.arange(8) == 3, np.nan, X)}, r"inputs\[3\] is not finite"),
        ({"inputs": X[[0, 1, 2, 2, 4, 5, 6, 7]]}, "inputs must increase"),
        ({"inputs": np.append(X[:7], 2 * np.pi), "outputs": np.append(Y[:7], 0.0)}, "pairs 0 and 7"),
        ({"outputs": 0.2 + 0 * Y}, "outputs are all one angle"),
        ({"B": None}, r"needs B=\(x, y\)"),
        ({"D": (0, 1)}, "takes no D; leave it out"),
        ({"B": (0, 0)}, "A and B are both"),
        ({"B": (np.inf, 0)}, "B must be finite"),
        ({"kind": "Stephenson II", "B": None, "D": (0, 0)}, "A and D are both"),
        ({"length": -1.0}, "length = -1.0 must be a positive length"),
    ],
)
def test_messages(change, says):
    call = {"kind": "Watt II", "inputs": X, "outputs": Y, "A": (0, 0), "B": (1, 0), "C": (2, 0)} | change
    with pytest.raises(nc.InputError, match=says):
        syn.precision_six_bars(**call)
