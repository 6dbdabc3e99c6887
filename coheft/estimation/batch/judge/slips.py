"""A grasp that slips: from some time on, a robot's grasp frame is elsewhere in the load.

Each robot's poses say where the load is, ``B_i = H_i T_i X_i^-1``. Where these differ, homes ``H_i`` and grasps ``X_i``
are off by constants, which are fitted out; what is left of one robot's view after a slip is a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.geometry.spatial import Array, Pose

_BATCH = 0.2
"""Samples are averaged over so long [s]."""
_FROM_THE_EDGE = 1.0
_LEFT = 0.1
"""Share of the squares that a slip may leave if it is the whole story."""


@dataclass(frozen=True)
class Slip:
    """One grasp's.

    Attributes:
        robot: Whose.
        time: When [s].
        turn_deg: By what angle.
        shift: How far the origin of the grasp frame went [m].
    """

    robot: int
    time: float
    turn_deg: float
    shift: float


def find_slip(poses: Array, times: Array, homes: Sequence[Pose], grasps: Sequence[Pose]) -> Slip | None:
    """The slip that explains nearly all by which robots' views of the load differ.

    Args:
        poses: ``x y z qx qy qz qw`` of N grasp frames in their home frames, shape (N, n, 7).
        times: Of the samples, shape (n,) [s].
        homes: Home frames in the world, as fitted to all of it.
        grasps: Grasp frames in the load, likewise.

    Returns:
        None if there is none, or if it does not explain enough.
    """
    views, design, batch_times = _views(poses, times, homes, grasps)
    count, batches = views.shape[0], views.shape[1]
    flat = views.reshape(count, -1)
    # In units of what turns and shifts change by from one batch to the next, which is noise but for a few.
    changes = np.abs(np.diff(views, axis=1)).reshape(count, batches - 1, 2, 3)
    sizes = np.median(changes, axis=(0, 1, 3))
    scale = np.tile(np.repeat(1.0 / np.maximum(sizes, 1e-12), 3), batches)
    basis = np.linalg.qr(design.reshape(batches * 6, -1) * scale[:, None])[0]
    rest = flat * scale
    rest = rest - rest @ basis @ basis.T
    before = float(np.sum(rest**2))
    inner = (batch_times > batch_times[0] + _FROM_THE_EDGE) & (batch_times < batch_times[-1] - _FROM_THE_EDGE)
    best: tuple[float, int, int, Array] | None = None
    for first in np.flatnonzero(inner):
        step = np.zeros((batches, 6, 6))
        step[first:] = np.eye(6)
        columns = step.reshape(-1, 6) * scale[:, None]
        columns = columns - basis @ (basis.T @ columns)
        solution = np.linalg.lstsq(columns, rest.T)[0].T
        # A step of one robot moves the mean of all, from which views count, too.
        gains = np.sum((solution @ columns.T) ** 2, axis=1) * count / (count - 1)
        robot = int(np.argmax(gains))
        if best is None or gains[robot] > best[0]:
            best = (float(gains[robot]), robot, int(first), solution[robot] * count / (count - 1))
    if best is None or before - best[0] > _LEFT * before:
        return None
    _, robot, start, jump = best
    # Perturbations are those of the load as the robot sees it, about the load's origin.
    shift = jump[3:] + np.cross(jump[:3], grasps[robot].translation)
    turn = float(np.degrees(np.linalg.norm(jump[:3])))
    return Slip(robot, float(batch_times[start]) - 0.5 * _BATCH, turn, float(np.linalg.norm(shift)))


def _views(poses: Array, times: Array, homes: Sequence[Pose], grasps: Sequence[Pose]) -> tuple[Array, Array, Array]:
    """By how much each robot's view of the load differs from the mean of all, in the load's axes, by batches.

    Returns:
        Turns and shifts (N, b, 6), what a constant error of a grasp or of a home adds to them, (b, 6, 12), and the
        batches' times (b,).
    """
    seen = [_load(own, home, grasp) for own, home, grasp in zip(poses, homes, grasps, strict=True)]
    rotations, positions = seen[0]
    differences = []
    for turned, moved in seen:
        turn = Rotation.from_matrix(rotations.swapaxes(-1, -2) @ turned).as_rotvec()
        shift = ((moved - positions)[:, None] @ rotations)[:, 0]
        differences.append(np.hstack([turn, shift]))
    views = np.array(differences)
    views -= views.mean(axis=0)
    of_home = _from_home(rotations, positions)
    design = np.concatenate([np.broadcast_to(np.eye(6), of_home.shape), of_home], axis=-1)
    length = max(1, round(_BATCH * (len(times) - 1) / (times[-1] - times[0])))
    batches = len(times) // length

    def mean(samples: Array) -> Array:
        result: Array = samples[: batches * length].reshape(batches, length, *samples.shape[1:]).mean(axis=1)
        return result

    return np.array([mean(own) for own in views]), mean(design), mean(times)


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
