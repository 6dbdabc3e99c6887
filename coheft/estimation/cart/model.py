"""A cart in the plane: rigid body dynamics in SE(2) with one axle, whose wheels do not slip sideways (Aguilera et al.).

Frames and symbols, used in all files of the cart:

- ``{s}`` is fixed to the floor, ``{b}`` to the cart: its x axis points forward, its origin is the middle of the axle of
  the fixed wheels. ``q = (x, y, theta)`` is the pose of ``{b}`` in ``{s}`` [m, m, rad].
- A planar wrench is ``(f_x, f_y, tau)`` [N, N, N·m], torque about the frame's origin. ``Gamma`` is a wrench on the cart
  about the origin of ``{b}`` in the axes of ``{s}``: the generalised force of ``q``. ``wrench_b`` is the same wrench in
  the axes of ``{b}``: ``Gamma = T(theta) wrench_b``.
- ``phi = (m, m d_x, m d_y, I + m |d|^2)``: mass, first moments and moment of inertia about the origin of ``{b}``, with
  ``d`` the centre of mass in ``{b}`` and ``I`` the moment of inertia about it. The dynamics are linear in them.
- ``sigma = (sigma_v, sigma_w)``: viscous friction, ``N = (sigma_v x_rate, sigma_v y_rate, sigma_w theta_rate)``. One
  number resists moving [N·s/m], another turning [N·m·s]; in the paper they are one.

The source is "Modeling and Inertial Parameter Estimation of Cart-like Nonholonomic Systems Using a Mobile Manipulator"
(Aguilera, Murtaza, Rogers, Hutchinson); its equations are cited as "Aguilera et al., eq. (5)".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, sin

import msgspec
import numpy as np

from coheft.estimation.geometry.spatial import Array


class CartBody(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mass properties and friction of a cart, as they are or as a pusher estimates them.

    Attributes:
        mass: [kg].
        com: ``d``, centre of mass in ``{b}`` [m].
        inertia: ``I``, about the centre of mass [kg·m²].
        friction: ``sigma``, of moving [N·s/m] and of turning [N·m·s].
    """

    mass: float
    com: tuple[float, float]
    inertia: float
    friction: tuple[float, float]

    @property
    def phi(self) -> Array:
        """``(m, m d_x, m d_y, I + m |d|^2)``, shape (4,)."""
        x, y = self.com
        return np.array([self.mass, self.mass * x, self.mass * y, self.inertia + self.mass * (x * x + y * y)])

    @property
    def parameters(self) -> Array:
        """``(phi, sigma)``, shape (6,)."""
        return np.concatenate([self.phi, self.friction])

    @staticmethod
    def of(phi: Array, friction: tuple[float, float]) -> CartBody:
        """Inverse of ``phi``."""
        mass, x, y = float(phi[0]), float(phi[1] / phi[0]), float(phi[2] / phi[0])
        return CartBody(mass, (x, y), float(phi[3]) - mass * (x * x + y * y), friction)

    def phi_derivative(self) -> Array:
        """Derivative of ``phi`` by ``(m, d_x, d_y, I)``, shape (4, 4)."""
        m, (x, y) = self.mass, self.com
        return np.array([[1, 0, 0, 0], [x, m, 0, 0], [y, 0, m, 0], [x * x + y * y, 2 * m * x, 2 * m * y, 1.0]])


def axes(theta: float) -> Array:
    """``T(theta)``, shape (3, 3): carries ``(x, y, turn)`` from the axes of ``{b}`` to those of ``{s}``."""
    c, s = cos(theta), sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def axes_derivative(theta: float) -> Array:
    """``dT / dtheta``, shape (3, 3)."""
    c, s = cos(theta), sin(theta)
    return np.array([[-s, -c, 0.0], [c, -s, 0.0], [0.0, 0.0, 0.0]])


def wheel_row(theta: float) -> Array:
    """``Lambda(q) = (-sin theta, cos theta, 0)``, shape (3,): the wheels do not slip, ``Lambda qd = 0`` (eq. 3)."""
    return axes(theta)[:, 1]


def wheel_row_derivative(theta: float) -> Array:
    """``dLambda / dtheta``, shape (3,)."""
    return axes_derivative(theta)[:, 1]


def mass_matrix(phi: Array, theta: float) -> Array:
    """``M(q)``, shape (3, 3) (Aguilera et al., below eq. 4)."""
    c, s = cos(theta), sin(theta)
    m, a, b, j = phi.tolist()
    x, y = -(a * s + b * c), a * c - b * s
    return np.array([[m, 0.0, x], [0.0, m, y], [x, y, j]])


def regressor(theta: float, rates: Array, accelerations: Array) -> Array:
    """``Y``, shape (3, 4), with ``Y phi == M qdd + C qd``, from ``qd`` (3,) and ``qdd`` (3,)."""
    c, s = cos(theta), sin(theta)
    squared = float(rates[2]) ** 2
    x, y, turn = accelerations.tolist()
    return np.array(
        [
            [x, -s * turn - c * squared, -c * turn + s * squared, 0.0],
            [y, c * turn - s * squared, -s * turn - c * squared, 0.0],
            [0.0, c * y - s * x, -c * x - s * y, turn],
        ]
    )


def resistance(friction: Sequence[float] | Array, rates: Array) -> Array:
    """``N``, shape (3,), from ``sigma`` (2,) and ``qd`` (3,)."""
    moving, turning = friction
    return np.array([moving, moving, turning]) * rates


@dataclass(frozen=True, eq=False)
class Accelerations:
    """Solution of the equations of motion.

    Attributes:
        accelerations: ``qdd``, shape (3,) [m/s², rad/s²].
        multiplier: ``lambda``, the wheels' sideways force, against ``Lambda`` [N].
        system: ``[[M, Lambda^T], [Lambda, 0]]``, shape (4, 4).
    """

    accelerations: Array
    multiplier: float
    system: Array


def forward_dynamics(
    phi: Array, friction: Sequence[float] | Array, theta: float, rates: Array, wrench_b: Array
) -> Accelerations:
    """Solve ``M qdd + C qd + N + Lambda^T lambda = Gamma``, ``Lambda qdd + Lambda_rate qd = 0``.

    The solution is ``qdd = M^-1 P (Gamma - C qd - N) - M^-1 Lambda^T (Lambda M^-1 Lambda^T)^-1 Lambda_rate qd``, with
    the projection ``P = I - Lambda^T (Lambda M^-1 Lambda^T)^-1 Lambda M^-1`` (Aguilera et al., eqs 5 and 9). Eq. (9)
    lacks the last term; without it, the cart drifts sideways in curves.

    Arguments are ``phi`` (4,), ``sigma`` (2,), the heading [rad], ``qd`` (3,) and the total wrench of all hands (3,).
    """
    turn_rate = float(rates[2])
    system = np.zeros((4, 4))
    system[:3, :3] = mass_matrix(phi, theta)
    system[:3, 3] = system[3, :3] = wheel_row(theta)
    right = np.empty(4)
    right[:3] = axes(theta) @ wrench_b - inverse_dynamics(phi, friction, theta, rates, np.zeros(3))
    right[3] = -turn_rate * wheel_row_derivative(theta) @ rates
    solution = np.asarray(np.linalg.solve(system, right), dtype=np.float64)
    return Accelerations(solution[:3], float(solution[3]), system)


def inverse_dynamics(
    phi: Array, friction: Sequence[float] | Array, theta: float, rates: Array, accelerations: Array
) -> Array:
    """``Gamma = M qdd + C qd + N``, shape (3,): the wrench that would cause this motion without the wheels' force.

    Multiples of ``Lambda^T`` can be added to it: the wheels take them up.
    """
    return regressor(theta, rates, accelerations) @ phi + resistance(friction, rates)
