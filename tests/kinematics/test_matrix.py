"""The number of lanes, tracing and mapping change neither status nor value: some combinations that cover all pairs.

All of them are a campaign, ``python -m benchmarks.matrix``.
"""

import itertools

import pytest

from benchmarks import matrix

# One pose, as many as the host takes side by side, and as many as are compiled; about thresholds see the campaign.
LANES = tuple(matrix.LANES[k] for k in (0, 2, -1))
SINGLE = [
    matrix.Case(kind, 1, 16, route, "float32")
    for kind, route in zip(matrix.RIGS, ("jit", "grad", "eager"), strict=True)
]


def test_every_two_settings_meet():
    axes = (tuple(matrix.RIGS), matrix.INPUTS, LANES, matrix.ROUTES)
    chosen = matrix.pairs(LANES)
    for i, j in itertools.combinations(range(4), 2):
        assert {(c[i], c[j]) for c in chosen} == set(itertools.product(axes[i], axes[j]))


@pytest.mark.slow
@pytest.mark.parametrize("case", [*matrix.pairs(LANES), *SINGLE], ids=str)
def test_routes_agree_with_what_is_right(case):
    assert matrix.disagreements(case) == []
