"""Time derivatives of poses on the host: the rows differentiated once more for every order, as their programs say."""

from collections.abc import Sequence

import numpy as np

from jaxnc.solvers.host.view import HostView


def rates(view: HostView, q: np.ndarray, known: Sequence[np.ndarray]) -> list[np.ndarray]:
    """First, second, … derivatives of all coordinates of solved poses, each ``(N, lanes)``; not finite if singular.

    `known` are those of the known coordinates, each ``(known, lanes)``.
    """
    plan, solve = view.plan, view.solver(q)
    found: list[np.ndarray] = []
    for values in known:
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.zeros_like(q)
        term[plan.known] = values
        for _ in range(1 if view.refines else 2):
            term[plan.unknown] -= solve(view.eq.rates(q, [*found, term])[plan.rows])
        found.append(term)
    return found
