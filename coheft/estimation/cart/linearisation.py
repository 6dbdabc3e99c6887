"""Exact derivatives of a cart's acceleration by its state, its parameters and the wrench.

The dynamics are an equation ``g(qdd, lambda; state, parameters, wrench) = 0`` that is linear in ``(qdd, lambda)``, so
the derivative of its solution is ``-system^-1 dg``: no matrix inverse has to be differentiated.
"""

from dataclasses import dataclass

import numpy as np

from coheft.estimation.cart.model import axes, axes_derivative, forward_dynamics, regressor
from coheft.estimation.geometry.spatial import Array

POSE, RATES, PHI, FRICTION = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 12)
STATE_SIZE = 12
"""State of the augmented filter: ``(q, qd, phi, sigma)`` (Aguilera et al., eq. 8, and friction)."""
_THETA, _TURN_RATE = 2, 5
_WRENCH = slice(STATE_SIZE, STATE_SIZE + 3)


@dataclass(frozen=True, eq=False)
class Linearised:
    """``xd = f(x, wrench_b)`` at one point.

    Attributes:
        rate: ``f``, shape (12,).
        by_state: ``F = df / dx``, shape (12, 12) (Aguilera et al., eq. 11).
        by_wrench: ``df / dwrench_b``, shape (12, 3).
    """

    rate: Array
    by_state: Array
    by_wrench: Array


def linearise(state: Array, wrench_b: Array) -> Linearised:
    """Rate of the augmented state (12,) under ``wrench_b`` (3,), and its derivatives; parameters are constant."""
    theta, rates, phi, friction = float(state[_THETA]), state[RATES], state[PHI], state[FRICTION]
    turn_rate = float(rates[2])
    solution = forward_dynamics(phi, friction, theta, rates, wrench_b)
    accelerations = solution.accelerations
    to_floor, to_floor_rate = axes(theta), axes_derivative(theta)
    by_phi = regressor(theta, rates, accelerations)
    row_rate = to_floor_rate[:, 1]
    # g = (Y phi + N + Lambda^T lambda - T wrench_b,  Lambda qdd + Lambda_rate qd), by each of its arguments.
    by = np.zeros((4, STATE_SIZE + 3))
    by[:3, _THETA] = phi[1] * by_phi[:, 2] - phi[2] * by_phi[:, 1]  # turning phi's moments turns Y the other way
    by[:3, _THETA] += to_floor_rate @ (np.array([0.0, solution.multiplier, 0.0]) - wrench_b)
    by[3, _THETA] = row_rate @ accelerations - turn_rate * to_floor[:, 1] @ rates
    moving, turning = friction.tolist()
    by[:3, RATES] = np.diag([moving, moving, turning])
    x, y = phi[1] * to_floor[:2, 0] + phi[2] * to_floor[:2, 1]
    by[:2, _TURN_RATE] -= 2.0 * turn_rate * np.array([x, y])
    by[3, RATES] = turn_rate * row_rate
    by[3, _TURN_RATE] += row_rate @ rates
    by[:3, PHI] = by_phi
    by[:2, FRICTION.start], by[2, FRICTION.stop - 1] = rates[:2], turn_rate
    by[:3, _WRENCH] = -to_floor
    derivative = -np.linalg.solve(solution.system, by)[:3]

    rate = np.zeros(STATE_SIZE)
    rate[POSE], rate[RATES] = rates, accelerations
    by_state = np.zeros((STATE_SIZE, STATE_SIZE))
    by_state[POSE, RATES] = np.eye(3)
    by_state[RATES] = derivative[:, :STATE_SIZE]
    by_wrench = np.zeros((STATE_SIZE, 3))
    by_wrench[RATES] = derivative[:, _WRENCH]
    return Linearised(rate, by_state, by_wrench)
