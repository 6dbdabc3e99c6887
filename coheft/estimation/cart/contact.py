"""Hands on a cart's handle: their wrenches on the cart, their best contact points, and their shares of a wrench."""

import numpy as np

from coheft.estimation.geometry.spatial import Array

_LEAST_FORCE = 1.0
"""Forces below this tell nothing of the best contact point [N]."""
MOVING = [0, 2]
"""Components of a ``wrench_b`` that move the cart: forward force and torque. The wheels take up the other."""


def grasp_map(contact: Array) -> Array:
    """``G``, shape (3, 3): maps a planar wrench from a contact point in ``{b}``, (2,) [m], to the origin of ``{b}``.

    The planar part of ``Ad_g^T B_a`` (Aguilera et al., eqs 22-24), the contact frame having the axes of ``{b}``.
    """
    x, y = contact.tolist()
    return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-y, x, 1.0]])


def leverage(contact: Array, arm: float) -> Array:
    """``G W^-1 G^T``, shape (3, 3), with ``W`` the weights of a hand's effort ``f^2 + (tau / arm)^2``.

    Those of several hands add up. It is also the covariance of the wrench on the cart if the variance of a hand's
    measured force is 1 and that of its torque ``arm^2``. The contact point is in ``{b}``, shape (2,) [m].
    """
    grasp = grasp_map(contact)
    return grasp @ np.diag([1.0, 1.0, arm**2]) @ grasp.T


def share(wrench_b: Array, contact: Array, arm: float, all_leverage: Array) -> Array:
    """One hand's share of a wrench about its contact point, shape (3,), such that all hands together need the least
    effort.

    Minimises ``sum_i w_i^T W w_i`` subject to ``G_1 w_1 + G_2 w_2 + ... = wrench_b`` (Aguilera et al., eq. 25) in the
    components that move the cart: ``w_i = W^-1 G_i^T E^T (E (sum_j G_j W^-1 G_j^T) E^T)^-1 E wrench_b``. So of the
    other hands it needs only the sum of the ``leverage``, shape (3, 3); contact and arm are as there.
    """
    multipliers = np.linalg.solve(all_leverage[np.ix_(MOVING, MOVING)], wrench_b[MOVING])
    return np.array([1.0, 1.0, arm**2]) * (grasp_map(contact)[MOVING].T @ multipliers)


def effort(wrench_b: Array, all_leverage: Array) -> float:
    """Root of ``sum_i f_i^2 + (tau_i / arm)^2`` over all hands that ``share`` a wrench [N]."""
    moving = wrench_b[MOVING]
    return float(np.sqrt(moving @ np.linalg.solve(all_leverage[np.ix_(MOVING, MOVING)], moving)))


class BestContact:
    """Contact point of least effort on a handle parallel to the y axis of ``{b}``, for one hand.

    With the contact at ``(x, y)``, the squared effort is ``f^2 + (tau + y f)^2 / (x^2 + arm^2)``. Summed over the last
    pushes with exponential forgetting, it is least at ``y = -sum(f tau) / sum(f^2)``. ``memory`` is the number of
    pushes in the time constant.
    """

    def __init__(self, memory: float) -> None:
        self._keep = 1.0 - 1.0 / memory
        self._products = 0.0
        self._squares = 0.0

    def after(self, wrench_b: Array) -> float | None:
        """Add a push, and return ``y`` of the best contact point [m]; None before the first push."""
        force, torque = float(wrench_b[0]), float(wrench_b[2])
        self._products = self._keep * self._products + force * torque
        self._squares = self._keep * self._squares + force * force
        return None if self._squares < _LEAST_FORCE**2 else -self._products / self._squares
