"""Differences between the poses of the load according to each robot.

According to robot i, the load's pose is ``B_i = H_i T_i X_i^-1``. Constant errors of homes ``H_i`` and grasps
``X_i`` are fitted; the remaining differences are noise, unless something is wrong.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.geometry.spatial import Array, Pose

BATCH = 0.2
"""Time over which samples are averaged [s]."""


class Views:
    """Differences of N robots' views of the load from their mean, in b batches.

    Rotations and translations are in the load's axes, in units of their median change between batches, which is noise.

    Attributes:
        time: Times of the batches, shape (b,) [s].
        scale: Factors of rotations and translations, shape (6,).
        rest: Differences without constant errors of homes and grasps, shape (N, b, 6).
        basis: Orthonormal basis of the effects of such errors, shape (b, 6, q).
        positions: Positions of each grasp frame in its home frame, minus their mean, in the load's axes, (N, b, 3) [m].
    """

    def __init__(self, evidence: Evidence) -> None:
        """Compare the poses of a recording, with home and grasp frames that were fitted to all of it."""
        poses, times = evidence.recording.stacked("pose"), evidence.recording.time
        length = max(1, round(BATCH * (len(times) - 1) / (times[-1] - times[0])))
        batches = len(times) // length

        def mean(samples: Array) -> Array:
            result: Array = samples[: batches * length].reshape(batches, length, *samples.shape[1:]).mean(axis=1)
            return result

        seen = [_load(*each) for each in zip(poses, evidence.homes, evidence.poses, strict=True)]
        rotations, positions = seen[0]
        to_load = rotations.swapaxes(-1, -2)
        differences, places = [], []
        for (turned, moved), own, home in zip(seen, poses, evidence.homes, strict=True):
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
        self.time, self.positions = mean(times), np.array(places)
        self.scale = np.repeat(1.0 / np.maximum(sizes, 1e-12), 3)
        basis = np.linalg.qr((design * self.scale[:, None]).reshape(batches * 6, -1))[0]
        flat = (views * self.scale).reshape(len(views), -1)
        self.rest = (flat - flat @ basis @ basis.T).reshape(views.shape)
        self.basis = basis.reshape(batches, 6, -1)


def _load(poses: Array, home: Pose, grasp: Pose) -> tuple[Array, Array]:
    """Orientations (n, 3, 3) and positions (n, 3) of the load according to one robot's poses (n, 7)."""
    to_load = grasp.inverse()
    own = home.rotation @ Rotation.from_quat(poses[:, 3:]).as_matrix()
    places = home.translation + poses[:, :3] @ home.rotation.T
    return own @ to_load.rotation, places + own @ to_load.translation


def _from_home(rotations: Array, positions: Array) -> Array:
    """Derivative of the load's pose, in its own axes, by a perturbation of the home frame in the world, (n, 6, 6)."""
    turned = rotations.swapaxes(-1, -2)
    result = np.zeros((len(positions), 6, 6))
    result[:, :3, :3] = result[:, 3:, 3:] = turned
    result[:, 3:, :3] = np.cross(turned, positions[:, None])
    return result
