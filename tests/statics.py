"""A load of 6 kg that three robots hold still in some orientations, by construction."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array, Pose

MASS, COM = 6.0, np.array([0.1, -0.05, 0.08])
"""The latter in the first grasp frame."""
NAMES = ("a", "b", "c")
_TURNS = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.1, 0.2, 1.9], [-0.2, 0.3, -1.2]])
_PLACES = np.array([[0.0, 0.0, 0.0], [0.7, 0.1, 0.05], [0.3, -0.4, 0.1]])
GRASPS = tuple(Pose(turn, place) for turn, place in zip(_TURNS.as_matrix(), _PLACES, strict=True))
_HOMES = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, 0.0, 2.2], [0.0, 0.0, -1.3]])
TILTS = np.array([[0, 0, 0], [0.6, 0, 0], [-0.5, 0.1, 0.3], [0, 0.6, 0], [0.1, -0.6, 0.2], [0.4, 0.4, -0.4]])


def statics(seed: int = 0, noise: float = 1.0, tilts: Array = TILTS) -> Recording:
    """Holds with noise of 0.1 mm, 0.2 mrad, 0.1 N, 0.01 N·m, times ``noise``."""
    rng = np.random.default_rng(seed)
    load = Rotation.from_rotvec(tilts)
    origin = np.column_stack([0.1 * tilts[:, 0], 0.2 * tilts[:, 1], 1.0 + 0.1 * tilts[:, 2]])
    lift = load.inv().apply([0.0, 0.0, MASS * 9.81])
    inner = rng.normal(size=(3, len(tilts), 3))
    forces = lift / 3.0 + inner - inner.mean(axis=0)
    moments = np.cross(COM, lift) - np.cross(_PLACES[:, None], forces).sum(axis=0)
    robots, time = {}, np.arange(len(tilts), dtype=np.float64)
    for name, turn, place, home, force in zip(NAMES, _TURNS, _PLACES, _HOMES, forces, strict=True):
        own = home.inv() * load * turn * Rotation.from_rotvec(2e-4 * noise * rng.normal(size=(len(tilts), 3)))
        where = home.inv().apply(origin + load.apply(place)) + 1e-4 * noise * rng.normal(size=(len(tilts), 3))
        pose = np.hstack([where, own.as_quat()])
        measured = np.hstack([turn.inv().apply(force), turn.inv().apply(moments / 3.0)])
        measured += noise * np.repeat([0.1, 0.01], 3) * rng.normal(size=measured.shape)
        robots[name] = RobotRecord(time, pose=pose, wrench=measured)
    return Recording(robots)
