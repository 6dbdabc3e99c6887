"""Sensors whose axes are not those of the grasp frame: rotated, exchanged, or left-handed.

The sensor reads ``Q^T`` times the force and the moment in the axes of the grasp frame, with ``Q`` orthogonal. For one
robot's sensor, a matrix of nine unknowns is fitted linearly; Gauss-Newton starts at the nearest orthogonal one. For all
sensors alike, the linear fit would find that no wrench and no load are best, so the starts are exchanges of axes and
rotations by half a right angle. Several are followed: before a step is made, wrong ones may leave less.
"""

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, REWEIGHTINGS, Fit, WrenchMisfit
from coheft.estimation.geometry.spatial import Array, skew

_TURNS, _ROUGH_TURNS = 6, 4
_FOLLOWED = 4
"""Number of starts from which axes of all sensors are fitted."""
_TURNED = 1e-6


def fit_turned(misfit: WrenchMisfit, robots: Sequence[int]) -> tuple[Array, Fit]:
    """Fit the axes of these robots' sensors, the same for all.

    Returns:
        ``Q`` (3, 3), whose columns are the sensor's axes in the grasp frame, and the fit of the load with it.
    """
    if len(robots) == 1:
        return _descended(misfit, robots, _start_of_one(misfit, robots[0]), _TURNS, REWEIGHTINGS)
    followed = [_descended(misfit, robots, start, _ROUGH_TURNS, 1) for start in _starts_of_all(misfit, robots)]
    best, _ = min(followed, key=lambda found: _rank(found[1]))
    return _descended(misfit, robots, best, _TURNS, REWEIGHTINGS)


def _descended(misfit: WrenchMisfit, robots: Sequence[int], axes: Array, steps: int, passes: int) -> tuple[Array, Fit]:
    """Axes and fit after steps of Gauss-Newton."""
    for _ in range(steps):
        # A further small rotation of the axes adds these to the total wrench.
        turns = [_both(skew(axis) @ axes) for axis in np.eye(3)]
        total = misfit.total_with(robots, misfit.wrenches @ _both(axes).T)
        fit = misfit.fit(-misfit.reading_columns(robots, turns), total=total, passes=passes)
        step = fit.solution[BODY_NUMBERS:]
        if np.abs(step).max() < _TURNED:
            break
        axes = Rotation.from_rotvec(np.clip(step, -0.5, 0.5)).as_matrix() @ axes
    return axes, fit


def _rank(fit: Fit) -> tuple[bool, float]:
    """Possible loads first: with all signs inverted, a load of negative mass fits as well."""
    return bool(fit.solution[0] <= 0.0), fit.misfit


def turned_words(axes: Array, whose: str) -> str:
    """Describe a sensor with these axes (3, 3)."""
    nearest = np.rint(axes)
    if np.linalg.det(axes) < 0.0:
        names = [f"{'-' if own.sum() < 0.0 else ''}{'xyz'[np.argmax(np.abs(own))]}" for own in nearest.T]
        how = (
            f": its x, y and z are {', '.join(names)} of the grasp frame" if np.abs(axes - nearest).max() < 0.1 else ""
        )
        return f"axes of the wrench of {whose} are left-handed{how}: axes were exchanged, or one has the opposite sign"
    turn = Rotation.from_matrix(axes).as_rotvec()
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / max(angle, 1e-9)
    return (
        f"the sensor of {whose} is turned against the grasp frame, by {np.degrees(angle):.3g} degrees about "
        f"({x:.2f}, {y:.2f}, {z:.2f})"
    )


def _start_of_one(misfit: WrenchMisfit, robot: int) -> Array:
    units = [_both(np.outer(row, column)) for row in np.eye(3) for column in np.eye(3)]
    fit = misfit.fit_readings([robot], units)
    left, _, right = np.linalg.svd(np.eye(3) - fit.solution[BODY_NUMBERS:].reshape(3, 3))
    result: Array = left @ right
    return result


def _starts_of_all(misfit: WrenchMisfit, robots: Sequence[int]) -> list[Array]:
    signs = [np.array(sign, dtype=np.float64) for sign in product((1.0, -1.0), repeat=3)]
    exchanges = [np.eye(3)[list(order)] * sign for order in permutations(range(3)) for sign in signs]
    right_handed = [axes for axes in exchanges if np.linalg.det(axes) > 0.0]
    halves = [Rotation.from_rotvec(0.25 * np.pi * axis).as_matrix() for axis in np.eye(3)]

    def rank(axes: Array) -> tuple[bool, float]:
        return _rank(misfit.fit(total=misfit.total_with(robots, misfit.wrenches @ _both(axes).T), passes=1))

    return sorted([*exchanges, *(half @ axes for half in halves for axes in right_handed)], key=rank)[:_FOLLOWED]


def _both(matrix: Array) -> Array:
    """The same (3, 3) for forces and for moments, (6, 6)."""
    return np.kron(np.eye(2), matrix).astype(np.float64)
