"""The physically possible body that fits best: projection in the metric of the information matrix.

A body exists if and only if its 4x4 pseudo-inertia is positive semi-definite (Wensing, Kim, Slotine 2017). That is
linear in ``theta = (m, m h, I_o)``, so the best possible body is the solution of a small convex problem,

    minimise  1/2 (theta - estimate)^T H (theta - estimate)   subject to   P(theta) >= 0,

solved with a logarithmic barrier and Newton's method. All iterates lie strictly inside, whatever the data.
"""

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import pack_symmetric, pseudo_inertia

_THINNEST = 1e-10
"""Smallest eigenvalue, with ones on the diagonal, of a pseudo-inertia that counts as positive despite rounding."""
_GAP = 1e-6
"""Largest difference of the cost from the optimum: in units of log-likelihood, and relative."""
_SMALLEST_SHARE = 1e-12
"""Share of the metric that is added in all directions, so that it is positive definite despite rounding."""
_GROWTH = 20.0
_ROUGHLY, _EXACTLY = 0.5, 1e-2
"""Newton decrements that end the search for a centre: for intermediate ones, and for the last one."""
_NEWTON_STEPS = 40
_INSIDE = 0.9
"""Largest share of the way to the border of what is possible that a step may go."""
_INWARDS = 1e-7
"""Share of the way to an interior point by which the result is moved, so that rounding cannot make it impossible."""


def parameters_of(pseudo: Array) -> Array:
    """Return the parameters of a pseudo-inertia: shape (4, 4) to (10,)."""
    sigma = pseudo[:3, :3]
    about_origin = np.trace(sigma) * np.eye(3) - sigma
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], pack_symmetric(about_origin)])


def is_possible(parameters: Array, thinnest: float = _THINNEST) -> bool:
    """Whether a body with ``theta``, shape (10,), can exist: mass and pseudo-inertia are safely positive.

    ``thinnest`` is the largest eigenvalue of a pseudo-inertia, with ones on its diagonal, that does not count so.
    """
    pseudo = pseudo_inertia(parameters)
    diagonal = pseudo.diagonal()
    if not diagonal.min() > 0.0:
        return False
    scale = np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(pseudo / scale[:, None] / scale)[0] > thinnest)


def nearest_possible(parameters: Array, information: Array, length: float) -> Array:
    """Return the possible ``theta`` of the highest likelihood.

    Args:
        parameters: Estimate of ``theta``, shape (10,); returned unchanged if it is possible.
        information: Its information matrix, shape (10, 10), symmetric, at least positive semi-definite.
        length: Rough size of the body [m], to balance metres and kilograms.

    Returns:
        Shape (10,), strictly possible.
    """
    if is_possible(parameters):
        return parameters
    # Coordinates in which the starting point is the identity, without units and with balanced directions.
    to_theta = _coordinates_around(_clipped(parameters, length))
    target = np.linalg.solve(to_theta, parameters).astype(np.float64)
    metric = to_theta.T @ information @ to_theta
    metric += _SMALLEST_SHARE * np.trace(metric) * np.eye(10)
    start = _BASIS_TRACE
    cost = _cost(start, target, metric)
    point, weight = start, 1.0 / (1.0 + cost)
    while weight * _GAP * (1.0 + cost) < 4.0:
        weight *= _GROWTH
        point = _centred(point, target, weight * metric, _ROUGHLY)
        cost = _cost(point, target, metric)
    point = _centred(point, target, weight * metric, _EXACTLY)
    return to_theta @ (point + _INWARDS * (start - point))


def _symmetric_basis() -> Array:
    """Return an orthonormal basis of the symmetric 4x4 matrices, shape (10, 4, 4)."""
    rows, columns = np.triu_indices(4)
    basis = np.zeros((10, 4, 4))
    basis[np.arange(10), rows, columns] = basis[np.arange(10), columns, rows] = np.where(
        rows == columns, 1.0, np.sqrt(0.5)
    )
    return basis


_BASIS = _symmetric_basis()
_FLAT_BASIS = _BASIS.reshape(10, 16)
_BASIS_TRACE: Array = np.trace(_BASIS, axis1=1, axis2=2)
"""Traces of the basis, which are also the coordinates of the identity."""


def _clipped(parameters: Array, length: float) -> Array:
    """Return an interior pseudo-inertia near any ``theta``: small eigenvalues are raised."""
    balance = np.array([length, length, length, 1.0])
    values, vectors = np.linalg.eigh(pseudo_inertia(parameters) / (balance[:, None] * balance))
    lifted = np.maximum(values, max(1e-2 * float(values[-1]), 1e-6))
    result: Array = balance[:, None] * ((vectors * lifted) @ vectors.T) * balance
    return result


def _coordinates_around(pseudo: Array) -> Array:
    """Return the matrix (10, 10) from z to the ``theta`` of ``T (sum_k z_k basis_k) T^T``, where ``T T^T = pseudo``."""
    root = np.linalg.cholesky(pseudo)
    return np.stack([parameters_of(matrix) for matrix in root @ _BASIS @ root.T], axis=1)


def _cost(point: Array, target: Array, metric: Array) -> float:
    return float(0.5 * (point - target) @ metric @ (point - target))


def _centred(point: Array, target: Array, metric: Array, tolerance: float) -> Array:
    """Minimize ``cost - log det`` with Newton's method from an interior point; the result is interior, too.

    Each step is solved in coordinates in which the point is the identity, and the curvature of ``log det``, too: near
    the border of what is possible, it would be nearly singular in others.
    """
    for _ in range(_NEWTON_STEPS):
        root = np.linalg.cholesky((point @ _FLAT_BASIS).reshape(4, 4))
        outwards = _FLAT_BASIS @ (root @ _BASIS @ root.T).reshape(10, 16).T
        gradient = outwards.T @ metric @ (point - target) - _BASIS_TRACE
        step = -np.linalg.solve(outwards.T @ metric @ outwards + np.eye(10), gradient)
        decrement = np.sqrt(max(-float(gradient @ step), 0.0))
        # The damped step of a self-concordant function stays inside (Nesterov, Nemirovskii 1994), and so do short
        # steps; rounding may make any step longer, if some directions are known much better than others.
        length = 1.0 / (1.0 + decrement) if decrement > 0.25 else 1.0
        lowest = float(np.linalg.eigvalsh((step @ _FLAT_BASIS).reshape(4, 4))[0])
        point = point + min(length, _INSIDE / max(-lowest, _INSIDE)) * (outwards @ step)
        if decrement < tolerance:
            break
    return point
