"""Whose sensors contradict the motion of the team: one test of innovations per robot and window of rows.

    s_i = sum of whitened residuals r_i of k rows / sqrt(k),    s_i . (1 + D P D^T)^-1 s_i ~ chi-square(12)

``r_i`` is what robot i reads less what all robots' fused motion lets it read, in standard deviations. Uncertain poses
shift it by ``D``, with the covariance ``P`` of the fit. A sensor that is frozen, saturated, biased or late, a clock, a
robot that let go and a liar all show here, and nothing else does: no vote is taken and no robot is asked.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from agents.efficient.settings import Guards
from coheft.estimation.moments.derivatives import MotionDerivatives
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.rows import KINEMATICS_SIZE
from coheft.estimation.spatial import Array

WINDOWS = np.array([1, 2, 4, 8, 16])
"""Numbers of newest rows that are tested."""
_LONGEST = int(WINDOWS[-1])


@dataclass(frozen=True)
class Contradiction:
    """A robot whose sensors contradict the team's motion.

    Attributes:
        robot: Its place in the team.
        rows: Over how many of the newest rows.
        size: The statistic over its threshold.
    """

    robot: int
    rows: int
    size: float


class Monitor:
    """Sums of the newest residuals.

    Args:
        count: Robots.
        guards: Thresholds.
    """

    def __init__(self, count: int, guards: Guards) -> None:
        self._count, self._guards = count, guards
        self._sums = np.zeros((_LONGEST + 1, KINEMATICS_SIZE * count))
        """Running sum after each of the newest rows, the newest last."""
        self._motion: list[Array] = []
        self._rows = 0

    def forget(self) -> None:
        """What came before does not count any more: poses are others, or a contradiction is over."""
        self._rows = 0
        self._sums[:] = 0.0

    def add(self, residuals: Array, motion: Array, estimate: Estimate) -> Contradiction | None:
        """The worst contradiction that a row completes.

        Args:
            residuals: In standard deviations, shape (12 N,).
            motion: ``psi`` of the row, shape (features,).
            estimate: With which both were seen.
        """
        sums = self._sums
        sums[:-1] = sums[1:]
        sums[-1] += residuals
        self._rows += 1
        self._motion = [*self._motion[1 - _LONGEST :], motion]
        windows = WINDOWS[: np.searchsorted(WINDOWS, self._rows, side="right")]
        means = (sums[-1] - sums[-1 - windows]).reshape(len(windows), self._count, KINEMATICS_SIZE)
        squares = np.square(means).sum(axis=2) / windows[:, None]
        place = int(squares.argmax())
        window, robot = divmod(place, self._count)
        limit = self._guards.largest_contradiction
        if squares.flat[place] <= limit:
            return None
        rows = int(windows[window])
        size = self._with_uncertain_poses(means[window, robot] / np.sqrt(rows), robot, rows, estimate) / limit
        return Contradiction(robot, rows, size) if size > 1.0 else None

    def _with_uncertain_poses(self, residual: Array, robot: int, rows: int, estimate: Estimate) -> float:
        """The statistic if poses are only known as well as the estimate says.

        A wrong pose of any robot shifts what that robot should read, and what all should read by the fused motion.
        """
        body, unknowns = estimate.body, estimate.body.unknowns
        motion = np.sum(self._motion[-rows:], axis=0) / np.sqrt(rows)
        shifts = MotionDerivatives.at(body).own @ motion  # of what robots should read, shape (N, own, 12)
        derivative = np.zeros((self._count, unknowns.own, KINEMATICS_SIZE))
        for fusion in (body.twist, body.accelerations):
            by_fusion = shifts[:, :, fusion.sensors] @ fusion.gain.swapaxes(1, 2)
            derivative += by_fusion @ body.predict[robot][:, fusion.part].T
        derivative[robot] -= shifts[robot]
        white = np.sqrt(body.weight[robot]) * derivative.reshape(-1, KINEMATICS_SIZE)
        places = np.arange(len(white))
        covariance = np.eye(KINEMATICS_SIZE) + white.T @ estimate.covariance[np.ix_(places, places)] @ white
        return float(residual @ np.linalg.solve(covariance, residual))
