"""How solved poses change on the host, in time and with the design: the theorem of implicit functions."""

from collections.abc import Sequence

import numpy as np

from jaxnc.solvers.host.view import HostView
from jaxnc.system.design import Drawn


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


def changes(
    view: HostView, drawn: Drawn, q: np.ndarray, rates: Sequence[np.ndarray] = ()
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Poses and derivatives with their changes, ``(N, lanes, 1 + changes)``; not finite at a singular position.

    The known coordinates and their rates stay. Solved poses and rates are ``(N, lanes)``.
    """
    plan, width = view.plan, drawn.home.shape[-1]
    matrix = view.matrices(q)[0]
    found: list[np.ndarray] = []
    for order, values in enumerate((q, *rates)):
        # The highest derivative enters the differentiated rows linearly, with the Jacobian for its factor.
        term = np.concatenate([values[..., None], np.zeros((*values.shape, width - 1), q.dtype)], axis=2)
        if not order:
            term[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
        terms = [*found, term]
        right = np.moveaxis(view.eq.changes(terms[0], terms[1:], drawn.constants)[plan.rows], 1, 0)
        term[plan.unknown, :, 1:] = -np.moveaxis(view.solve(matrix, right), 0, 1)
        found.append(term)
    return found[0], found[1:]


def taken_up(view: HostView, drawn: Drawn, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far the rows change with the design, and how far that no motion takes up, both ``(lanes, changes)``.

    Arguments are as of `changes`.
    """
    plan = view.plan
    at = np.concatenate([q[..., None], np.zeros((*q.shape, drawn.home.shape[-1] - 1), q.dtype)], axis=2)
    at[plan.fixed, :, 1:] = drawn.home[plan.fixed][:, None, 1:]
    change = np.moveaxis(view.eq.changes(at, (), drawn.constants)[plan.rows], 1, 0)
    basis = np.linalg.qr(view.matrices(q)[0] / view.inner)[0]
    rest = change - basis @ (np.swapaxes(basis, 1, 2) @ change)
    return np.linalg.norm(change, axis=1), np.linalg.norm(rest, axis=1)
