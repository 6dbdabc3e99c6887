"""Test for a slip among the rows of one fit: do the newest rows show another pose of a grasp than all before?

    S = e_k,    V = H_k - H_k H^-1 H_k + D    of one pose,    S^T V^-1 S ~ chi-square with 6 degrees of freedom

with the score ``e_k`` and the information ``H_k`` of the newest ``k`` rows, motion and wrenches, at a fit to all rows
and to what was known before, whose information is ``H``. The fit has adapted its poses to rows of both kinds, so its
residuals alone hardly show a slip. Where sensors drift within the chapter, ``D`` is what that adds. If the anchor has
slipped, all other poses seem to have changed.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments import rows
from coheft.estimation.moments.beside_fit import BesideFit
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.change import windows
from coheft.estimation.moments.change_at_fit import Shown, change_within_fit
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives, whitening
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.moments import ProjectedMoments, evaluated_moments, wrench_indices
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.unknowns import POSE_SIZE

_TESTED = slice(2, None, 3)
"""Every third window is tested first, from 3 rows on."""
_WORTH_A_SEARCH, _SEARCHED = 0.4, 9
"""If the statistic is at least this share of its threshold, so many rows around the likeliest one are tried."""
_DRIFTING = np.r_[rows.W, rows.A]
"""Sensors of motion that may drift."""


class PoseStep(NamedTuple):
    """The likeliest step of a pose: the index of the first row after it, the robot, and the statistic over its
    threshold.
    """

    first: int
    robot: int
    statistic: float


class NewestRows:
    """What newest rows show of all poses at a fit to all rows.

    Args:
        estimate: The fit.
        chapter: The rows.
    """

    def __init__(self, estimate: Estimate, chapter: Chapter) -> None:
        self._body, self._buffer = body, buffer = estimate.body, chapter.buffer
        of_fit, poses = estimate.derivatives, body.unknowns.poses
        by_poses = of_fit.motion.derivatives.by_poses(poses), of_fit.wrench.by_poses(poses)
        self._poses = BesideFit(of_fit, *by_poses, POSE_SIZE)
        self._noise = self._poses.noise_alone(1.0, 0.0), self._poses.noise_alone(0.0, 1.0)  # in one row, (N, 6, 6) each
        nothing = ProjectedMoments.of(buffer.rows[:0], body)
        self._moments = {buffer.count: (nothing, nothing)}  # of all rows since an index, and of wrenches

    def since(self, first: int) -> Shown:
        """Of the rows from this index on, of each robot's pose."""
        buffer, body, later = self._buffer, self._body, min(index for index in self._moments if index >= first)
        of_all, of_load = self._moments[later]
        if first >= buffer.start:
            of_all = of_load = of_all + ProjectedMoments.of(buffer.rows[first:later], body)
        else:  # wrenches before are of another load
            of_all += ProjectedMoments.of(buffer.rows[first:later], body)
            of_load += ProjectedMoments.of(buffer.rows[min(buffer.start, later) : later], body)
        self._moments[first] = of_all, of_load
        moments = evaluated_moments(body, of_all, of_load)
        score, information, alone = self._poses.evidence(moments)
        noise = moments.motion.number * self._noise[0] + moments.wrench.number * self._noise[1]
        by_robot = information.reshape(*alone.shape[:2], -1)
        return Shown(score.reshape(-1, POSE_SIZE), by_robot, alone + noise, noise)


def likeliest_pose_step(
    estimate: Estimate, chapter: Chapter, anchor: int, drift: ScoreDrift | None, false_alarm: float
) -> PoseStep | None:
    """Return the likeliest step of a pose, None if there are too few rows.

    Args:
        estimate: The fit to all rows of the chapter, with all poses and a load.
        chapter: Rows, and what was known before.
        anchor: Index of the robot whose pose is fixed.
        drift: Computes ``D``; None if sensors do not drift.
        false_alarm: Probability that the newest ``k`` rows show a step of one robot's pose by chance.
    """
    newest, count = NewestRows(estimate, chapter), chapter.buffer.count
    threshold = chi_square_threshold(POSE_SIZE, false_alarm)

    def likeliest(first: int) -> PoseStep:
        by_drift = 0.0 if drift is None else drift.covariances(first)
        statistics = change_within_fit(newest.since(first), estimate.inverse, by_drift)
        statistics[anchor] = 0.0
        robot = int(statistics.argmax())
        return PoseStep(first, robot, float(statistics[robot]) / threshold)

    firsts = (count - windows(count)[_TESTED]).tolist()
    if chapter.prior is not None:
        firsts.append(0)
    steps = list(map(likeliest, firsts))
    largest = max(steps, key=lambda step: step.statistic, default=None)
    if largest is None or largest.statistic < _WORTH_A_SEARCH:
        return largest
    later = min((first for first in firsts if first > largest.first), default=largest.first)
    earlier = max((first for first in firsts if first < largest.first), default=0)
    between = np.unique(np.linspace(later, earlier, _SEARCHED).astype(int)).tolist()
    return max(map(likeliest, between), key=lambda step: step.statistic)


class ScoreDrift:
    """How far drifting offsets of sensors move the scores of all poses, in the newest rows of a chapter.

        S = sum of J_t^T (b_t - mean b),    cov(S) = sum_t C_t^T Q C_t,    C_t = A_t - A (n - t) / n

    over ``n`` rows, with a random walk ``b`` whose steps have the covariance ``Q``, the sum ``A_t`` of the derivatives
    ``J`` of those of the newest rows that follow step ``t``, and ``A`` that of all newest rows. The mean of ``b`` is
    among the unknowns of a fit. Derivatives of a robot's own motion sensors and of the total wrench count; what the
    drift of the fused motion adds to the other robots' residuals and to that of the wrench is left out.

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
        wrench, root = WrenchDerivatives.at(body, motion), whitening(body)
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

    def covariances(self, first: int) -> Array:
        """Covariances (N, 6, 6) of the scores of all poses in the rows from this index on."""
        count, number = self._derivatives.shape[:2]
        following = np.zeros_like(self._derivatives)
        following[:, first:] = np.cumsum(self._derivatives[:, first:][:, ::-1], axis=1)[:, ::-1]
        following[:, :first] = following[:, first, None]
        following -= following[:, :1] * ((number - np.arange(number)) / number)[:, None, None]
        steps = (self._periods[:, None, None] * following).reshape(count, -1, POSE_SIZE)
        moved = (self._steps[:, None] @ following).reshape(count, -1, POSE_SIZE)
        result: Array = steps.swapaxes(1, 2) @ moved
        return result
