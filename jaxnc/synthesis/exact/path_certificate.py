"""Linkages whose solutions were followed, and their certificates.

Products such as q r' and q' r as unknowns of their own make the bars' equations quadratic in them, q and γ; the real
and imaginary parts of a number and of its primed one are what stands for the two. See
`jaxnc.synthesis.exact.bar_paths` for the letters.
"""

import collections
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from jaxnc.continuation.certificate import are_disjoint, certify
from jaxnc.continuation.twofold import Twofold
from jaxnc.errors import counted
from jaxnc.synthesis.exact.bar_paths import BarPaths
from jaxnc.synthesis.exact.linkage import GuidedFourBar, Listed

if TYPE_CHECKING:
    from jaxnc.synthesis.exact.six_bars import SixBarDesign


def certify_designs(here: BarPaths, w: np.ndarray, others: Sequence[np.ndarray]) -> tuple[np.ndarray, bool]:
    """Find which real solutions are proved to exist and to be alone, and whether those are all proved different.

    Args:
        here: the equations of bars and turns, those at the end.
        w: solutions and their turns.
        others: the other equations, as quadratic forms of 1, q, q', r and r', ``(9, 9)``.

    The proof is of equations with these very numbers, where places are sums of several but for one rounding of each
    coefficient: conditions of 1e9 leave none for others beside them.
    """
    (known,), pairs = here.places(np.ones(1), 0), here.pairs
    count = known.c[0].shape[1]
    z, turns = w[:8].reshape(4, 2, -1), w[8:].reshape(2, count, -1)
    made = [np.stack([z[side][bar] * z[3 - side][k] for bar, k in pairs]) for side in (0, 1)]  # q r' and q' r
    one, primed = (np.concatenate([z[side], z[2 + side], made[side], turns[side]]) for side in (0, 1))
    unknowns = np.real(np.concatenate([(one + primed) / 2, (one - primed) / 2j]))
    half, first = len(one), 1 + 4 + len(pairs)  # where γ begins
    units = np.eye(1 + 2 * half, dtype=complex)
    q, r, n = units[1:3], units[3:5], units[5:first]

    def other(v: np.ndarray) -> np.ndarray:
        return np.concatenate([v[..., :1], v[..., 1 + half :], v[..., 1 : 1 + half]], axis=-1)

    def times(v: np.ndarray, u: np.ndarray) -> np.ndarray:
        return (np.outer(v, u) + np.outer(u, v)) / 2

    rows, low = [], []
    for at, (bar, k) in enumerate(pairs):
        product = times(units[0], n[at]) - times(q[bar], other(r[k]))
        mirrored = times(units[0], other(n[at])) - times(other(q[bar]), r[k])
        rows += [product + mirrored, (product - mirrored) / 1j]
    for j in range(count):
        g = units[first + j]
        for bar in (0, 1):
            b, bb = (side[bar, 0, 0] for side in known.b)
            c, cc = (side[bar, j, 0] for side in known.c)
            p, pp, move, back = (value * units[0] for value in (b, bb, c, cc))
            there, barred = (b + c) * other(q[bar]), (bb + cc) * q[bar]  # q' (p + Δ) and q (p' + Δ')
            for at, k in ((at, k) for at, (of, k) in enumerate(pairs) if of == bar):
                s, ss = (0.0, 0.0) if known.s is None else (side[k, j, 0] for side in known.s)
                p, pp = p + r[k], pp + other(r[k])
                move, back = move + s * r[k], back + ss * other(r[k])
                there, barred = there + (1.0 + s) * other(n[at]), barred + (1.0 + ss) * n[at]
            bars = times(barred, g) + times(there, other(g))
            rows.append(bars + times(q[bar] + p, back) + times(other(q[bar]) + pp + back, move))
            # What rounding took from the constant, of which the other terms may leave little.
            low.append((Twofold(b) * cc + (Twofold(bb) + cc) * c - rows[-1][0, 0]).rounded())
        rows.append(times(g, other(g)) + times(units[0], g + other(g)))
        low.append(0.0)
    numbers = np.concatenate([units[:1], q, other(q), r, other(r)])
    rows += [numbers.T @ form @ numbers for form in others]
    forms = _as_real(np.array(rows))
    lost = np.real(np.concatenate([np.zeros(2 * len(pairs)), low, np.zeros(len(others))]))
    balls = certify(forms, unknowns, _residuals(forms, lost, unknowns))
    return balls.real, are_disjoint(unknowns, balls)


def _residuals(equations: np.ndarray, low: np.ndarray, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of the equations with twice the digits, and a bound of their error, ``(solutions, n)`` both."""
    y = np.concatenate([np.ones((1, unknowns.shape[1])), unknowns])
    upper = np.triu(equations) + np.triu(equations, 1)
    most = int((upper != 0.0).sum(axis=(1, 2)).max())
    first, second, factor = np.zeros((3, most, len(equations)))
    for r, form in enumerate(upper):
        i, j = np.nonzero(form)
        first[: len(i), r], second[: len(i), r], factor[: len(i), r] = i, j, form[i, j]
    total, large = Twofold(np.broadcast_to(low[:, None], (len(low), y.shape[1]))), 0.0
    for i, j, c in zip(first.astype(int), second.astype(int), factor[:, :, None], strict=True):
        total = total + Twofold(y[i]) * y[j] * c
        large = large + np.abs(y[i] * y[j] * c)
    value = np.real(total.rounded())
    # Rounding of one product and sum with twice the digits is below 2^-100.
    return value.T, (2.0**-98 * (most + 4) * large + 2.0**-52 * np.abs(value)).T


def _as_real(forms: np.ndarray) -> np.ndarray:
    """Quadratic forms of numbers and then their primed ones as forms of their real and imaginary parts."""
    half = (forms.shape[1] - 1) // 2
    turn = np.zeros((1 + 2 * half, 1 + 2 * half), complex)
    turn[0, 0] = 1.0
    k = np.arange(half)
    turn[1 + k, 1 + k] = turn[1 + half + k, 1 + k] = 1.0
    turn[1 + k, 1 + half + k], turn[1 + half + k, 1 + half + k] = 1j, -1j
    return np.real(turn.T @ forms @ turn)


D = TypeVar("D", bound="GuidedFourBar | SixBarDesign")


@dataclasses.dataclass(frozen=True)
class FollowedDesigns(Listed[D]):
    """All real solutions of a task whose complex ones were followed there; see its kinds."""

    designs: tuple[D, ...]
    expected: int
    found: int
    routes: int
    missing: int
    proved: tuple[bool, ...]
    disjoint: bool

    @property
    def complete(self) -> bool:
        """True if every path ended in a solution of its own: as many as a general task has."""
        return self.found == self.expected

    @property
    def statement(self) -> str:
        """What is proved and what was observed, in sentences."""
        if self.complete:
            ends = "none is missing"
        elif not self.missing:
            ends = "the other paths ended at infinity, in singular solutions or where a bar has no length"
        else:
            ends = f"at most {self.missing} more are regular and were missed, in {counted(self.routes, 'route')}"
        told = f"all {len(self.proved)}" if all(self.proved) else f"{sum(self.proved)} of {len(self.proved)}"
        return (
            f"Observed: {self.found} of {self.expected} solutions, real and complex; {ends}. "
            f"Proved: {told} real ones exist and are alone{', no two of them one' * self.disjoint}."
        )

    def describe(self, counts: str) -> str:
        """Say how many designs have which defects, what is proved, and which designs work."""
        works = [design for design in self if not design.defects]
        kinds = collections.Counter(", ".join(design.defects) for design in self if design.defects)
        defects = "".join(f", {count} with {kind} defect" for kind, count in sorted(kinds.items()))
        lines = [f"{counts}: {len(works)} without defects{defects}", self.statement, *map(str, works)]
        return "\n  ".join(lines)
