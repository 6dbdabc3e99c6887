"""Sensors whose axes are not those of the grasp frame: turned, exchanged, or of another handedness.

What a sensor reads is ``Q^T`` times the wrench in the axes of the grasp frame, ``Q`` orthogonal, for the force and for
the moment. If it is one robot's, a matrix of nine unknowns fits linearly; the orthogonal one next to it is the start of
Gauss-Newton. If all are alike, that would be no wrench and no load: the start is the best exchange of axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.body import total_wrench
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, Fit, WrenchMisfit
from coheft.estimation.geometry.spatial import Array, skew

_TURNS = 6
_TURNED = 1e-6


def fit_turned(misfit: WrenchMisfit, robots: Sequence[int]) -> tuple[Array, Fit]:
    """The axes of these robots' sensors, all alike, that fit best.

    Returns:
        ``Q`` (3, 3), whose columns are the sensor's axes in the grasp frame, and the fit of the load with it.
    """
    axes = _start_of_one(misfit, robots[0]) if len(robots) == 1 else _start_of_all(misfit, robots)
    for _ in range(_TURNS):
        # Turning the axes a little further adds this to the total wrench.
        turns = [_both(skew(axis) @ axes) for axis in np.eye(3)]
        fit = misfit.fit(-_columns(misfit, robots, turns), total=_total(misfit, robots, axes))
        step = fit.solution[BODY_NUMBERS:]
        if np.abs(step).max() < _TURNED:
            break
        axes = Rotation.from_rotvec(np.clip(step, -0.5, 0.5)).as_matrix() @ axes
    return axes, fit


def turned_words(axes: Array, whose: str) -> str:
    """What is wrong with a sensor that has these axes (3, 3)."""
    nearest = np.rint(axes)
    if np.linalg.det(axes) < 0.0:
        how = f"left-handed: {_named(nearest)}" if np.abs(axes - nearest).max() < 0.1 else "left-handed"
        return f"axes of the wrench of {whose} are {how}: axes were exchanged, or one has the opposite sign"
    turn = Rotation.from_matrix(axes).as_rotvec()
    angle = float(np.linalg.norm(turn))
    x, y, z = turn / max(angle, 1e-9)
    return (
        f"the sensor of {whose} is turned against the grasp frame, by {np.degrees(angle):.3g} degrees about "
        f"({x:.2f}, {y:.2f}, {z:.2f})"
    )


def _start_of_one(misfit: WrenchMisfit, robot: int) -> Array:
    units = [_both(np.outer(row, column)) for row in np.eye(3) for column in np.eye(3)]
    fit = misfit.fit(_columns(misfit, [robot], units), [(robot, units)])
    left, _, right = np.linalg.svd(np.eye(3) - fit.solution[BODY_NUMBERS:].reshape(3, 3))
    result: Array = left @ right
    return result


def _start_of_all(misfit: WrenchMisfit, robots: Sequence[int]) -> Array:
    signs = [np.array(sign, dtype=np.float64) for sign in product((1.0, -1.0), repeat=3)]
    exchanges = [np.eye(3)[list(order)] * sign for order in permutations(range(3)) for sign in signs]

    def rank(axes: Array) -> tuple[bool, float]:
        """With all signs the other way round a load of negative mass fits as well."""
        fit = misfit.fit(total=_total(misfit, robots, axes), passes=1)
        return fit.solution[0] <= 0.0, fit.misfit

    return min(exchanges, key=rank)


def _both(matrix: Array) -> Array:
    """The same (3, 3) for forces and for moments, (6, 6)."""
    result: Array = np.kron(np.eye(2), matrix).astype(np.float64)
    return result


def _total(misfit: WrenchMisfit, robots: Sequence[int], axes: Array) -> Array:
    """The total wrench if these robots' sensors have these axes."""
    wrenches = misfit.wrenches.copy()
    for robot in robots:
        wrenches[robot] = wrenches[robot] @ _both(axes).T
    return total_wrench(wrenches, misfit.poses)


def _columns(misfit: WrenchMisfit, robots: Sequence[int], maps: Sequence[Array]) -> Array:
    """What readings, multiplied by each map (6, 6), add to the total wrench, shape (n, 6, q)."""
    columns = [
        np.stack([misfit.wrenches[robot] @ (misfit.adjoints[robot] @ one).T for one in maps], axis=-1)
        for robot in robots
    ]
    result: Array = np.sum(columns, axis=0)
    return result


def _named(axes: Array) -> str:
    """Which axis of the grasp frame each of the sensor's is."""
    names = []
    for name, column in zip("xyz", axes.T, strict=True):
        index = int(np.argmax(np.abs(column)))
        names.append(f"its {name} is {'-' if column[index] < 0.0 else ''}{'xyz'[index]} of the grasp frame")
    return ", ".join(names)
