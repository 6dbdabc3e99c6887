"""A bar of 4 kg that two robots hold by its ends and turn: what they measure at any times, exactly."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.geometry.spatial import Array

MASS = 4.0
ENDS = {"left": -0.5, "right": 0.5}
"""Where robots hold it, along the bar from its middle [m]."""
_INERTIA = np.array([0.02, 0.33, 0.34])
_STEP = 1e-4


def poses(time: Array, robot: str) -> Array:
    """Of the grasp frame in the home frame at times (n,): shape (n, 7), as recordings have it."""
    turned = _turned(time)
    return np.hstack([turned.apply([ENDS[robot], 0.0, 0.0]) + [0.0, 0.0, 1.0], turned.as_quat()])


def wrenches(time: Array) -> Array:
    """Of either robot on the bar at times (n,): ``(f, t)``, shape (n, 6)."""
    force = _turned(time).inv().apply([0.0, 0.0, MASS * 9.81])
    w = _rates(time)
    alpha = (_rates(time + _STEP) - _rates(time - _STEP)) / (2.0 * _STEP)
    return np.hstack([force, _INERTIA * alpha + np.cross(w, _INERTIA * w)]) / 2.0


def _turned(time: Array) -> Rotation:
    return Rotation.from_euler("XYZ", 0.3 * np.sin(np.outer(time, [0.9, 1.3, 1.7])))


def _rates(time: Array) -> Array:
    result: Array = (_turned(time - _STEP).inv() * _turned(time + _STEP)).as_rotvec() / (2.0 * _STEP)
    return result
