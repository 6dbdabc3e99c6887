"""Where each robot's poses have the load, against where the others have it.

Each robot's poses say where the load is, ``B_i = H_i T_i X_i^-1``. Where these differ, homes ``H_i`` and grasps ``X_i``
are off by constants, which are fitted out; what is left is noise, unless something is wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.geometry.spatial import Array, Pose

BATCH = 0.2
"""Samples are averaged over so long [s]."""


@dataclass(frozen=True, eq=False)
class Views:
    """By how much N robots' views of the load differ from the mean of all, by b batches.

    Turns and shifts are in the load's axes, in units of what they change by from one batch to the next, which is noise
    but for a few.

    Attributes:
        time: Of the batches, shape (b,) [s].
        scale: By which turns and shifts were multiplied, shape (6,).
        rest: What constant errors of homes and grasps leave, shape (N, b, 6).
        basis: Orthonormal, of what such errors do, shape (b, 6, q).
        positions: Of each grasp frame in its home frame less their mean, in the load's axes, shape (N, b, 3) [m].
    """

    time: Array
    scale: Array
    rest: Array
    basis: Array
    positions: Array

    @classmethod
    def of(cls, evidence: Evidence) -> Self:
        """Compare the poses of a recording, with home and grasp frames that were fitted to all of it."""
        poses, times = evidence.recording.stacked("pose"), evidence.recording.time
        homes, grasps = evidence.homes, evidence.poses
        length = max(1, round(BATCH * (len(times) - 1) / (times[-1] - times[0])))
        batches = len(times) // length

        def mean(samples: Array) -> Array:
            result: Array = samples[: batches * length].reshape(batches, length, *samples.shape[1:]).mean(axis=1)
            return result

        seen = [_load(own, home, grasp) for own, home, grasp in zip(poses, homes, grasps, strict=True)]
        rotations, positions = seen[0]
        to_load = rotations.swapaxes(-1, -2)
        differences, places = [], []
        for (turned, moved), own, home in zip(seen, poses, homes, strict=True):
            turn = Rotation.from_matrix(to_load @ turned).as_rotvec()
            shift = (to_load @ (moved - positions)[..., None])[..., 0]
            differences.append(mean(np.hstack([turn, shift])))
            away = (own[:, :3] - own[:, :3].mean(axis=0)) @ home.rotation.T
            places.append(mean((to_load @ away[..., None])[..., 0]))
        views = np.array(differences)
        views -= views.mean(axis=0)
        of_home = mean(_from_home(rotations, positions))
        design = np.concatenate([np.broadcast_to(np.eye(6), of_home.shape), of_home], axis=-1)
        sizes = np.median(np.abs(np.diff(views, axis=1)).reshape(-1, 2, 3), axis=(0, 2))
        scale = np.repeat(1.0 / np.maximum(sizes, 1e-12), 3)
        basis = np.linalg.qr((design * scale[:, None]).reshape(batches * 6, -1))[0]
        flat = (views * scale).reshape(len(views), -1)
        rest = (flat - flat @ basis @ basis.T).reshape(views.shape)
        return cls(mean(times), scale, rest, basis.reshape(batches, 6, -1), np.array(places))


def _load(poses: Array, home: Pose, grasp: Pose) -> tuple[Array, Array]:
    """Orientations (n, 3, 3) and positions (n, 3) of the load as one robot sees it."""
    to_load = grasp.inverse()
    own = home.rotation @ Rotation.from_quat(poses[:, 3:]).as_matrix()
    places = home.translation + poses[:, :3] @ home.rotation.T
    return own @ to_load.rotation, places + own @ to_load.translation


def _from_home(rotations: Array, positions: Array) -> Array:
    """How a small turn and shift of the home frame, in the world, move the load as seen in its own axes, (n, 6, 6)."""
    turned = rotations.swapaxes(-1, -2)
    result = np.zeros((len(positions), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = turned
    result[:, 3:, :3] = np.cross(turned, positions[:, None])
    return result
