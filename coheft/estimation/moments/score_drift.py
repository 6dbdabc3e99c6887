"""How far drifting offsets of sensors move the score of one pose, in the newest rows of a chapter.

    S = sum of J_t^T (b_t - mean b),    cov(S) = sum_t C_t^T Q C_t,    C_t = A_t - A (n - t) / n

over ``n`` rows, with a random walk ``b`` whose steps have the covariance ``Q``, the sum ``A_t`` of the derivatives
``J`` of those of the newest rows that follow step ``t``, and ``A`` that of all newest rows. The mean of ``b`` is among
the unknowns of a fit. Derivatives of a robot's own motion sensors and of the total wrench count; what the drift of the
fused motion adds to the other robots' residuals and to that of the wrench is left out.
"""

from __future__ import annotations

import numpy as np

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import whitening, wrench_derivatives
from coheft.estimation.moments.moments import wrench_indices
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.unknowns import POSE_SIZE

_DRIFTING = np.r_[rows.W, rows.A]


class ScoreDrift:
    """Drift of the scores of all poses.

    Args:
        body: Matrices at the state of a fit, which has a load.
        buffer: Rows of the chapter.
        settings: Settings of the fit; some sensors drift.
    """

    def __init__(self, body: BodyModel, buffer: RowBuffer, settings: FitSettings) -> None:
        count, every = body.count, buffer.rows[: buffer.count]
        motion, psi = MotionDerivatives.at(body), every @ body.motion_map.T
        weighted = np.sqrt(body.weight)[:, None, _DRIFTING, None] * motion.own[:, :POSE_SIZE, _DRIFTING]
        of_motion = np.einsum("iacf,tf->itca", weighted, psi)
        wrench, root = wrench_derivatives(body, motion), whitening(body)
        of_load = every[buffer.start :]  # wrenches before are of another load
        own = of_load[:, wrench_indices(count, body.unknowns.errors)].reshape(
            len(of_load), count, wrench.local.shape[3]
        )
        of_wrench = np.zeros((count, len(every), 6, POSE_SIZE))
        of_wrench[:, buffer.start :] = np.einsum("iacw,tiw->itca", wrench.local[:, :POSE_SIZE], own)
        common = wrench.common[body.unknowns.poses]
        of_wrench[:, buffer.start :] += np.einsum("iacf,tf->itca", common, psi[buffer.start :])
        self._derivatives = np.concatenate([of_motion, of_wrench], axis=2)  # (N, n, 12, 6)
        self._periods = np.diff(buffer.numbers[: buffer.count], prepend=buffer.numbers[0] - 1)  # rows may be missing
        self._steps = np.zeros((count, 12, 12))
        kinematics = settings.drifted_kinematics(settings.period)[:, _DRIFTING]
        self._steps[:, range(6), range(6)] = kinematics
        self._steps[:, 6:, 6:] = root @ settings.drifted_wrench(body, settings.period) @ root.T

    def covariance(self, first: int, robot: int) -> Array:
        """Covariance (6, 6) of the score of a robot's pose in the rows from this index on."""
        derivatives = self._derivatives[robot]
        number = len(derivatives)
        following = np.zeros_like(derivatives)
        following[first:] = np.cumsum(derivatives[first:][::-1], axis=0)[::-1]
        following[:first] = following[first]
        following -= following[0] * ((number - np.arange(number)) / number)[:, None, None]
        steps = self._periods[:, None, None] * following
        result: Array = np.einsum("tca,cd,tdb->ab", steps, self._steps[robot], following, optimize=True)
        return result
