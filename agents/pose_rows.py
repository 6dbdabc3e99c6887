"""What robots tell each other for the fits of their poses: rows of tables, and what they mean."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.spatial import Array, Pose

SCORE_SIZE = 9
"""Numbers of a row that tells a score."""
FIT_SIZE = 4 + Pose.SIZE
"""Numbers of a row that tells a fit."""


def score_row(version: int, square: float, count: float, score: Array) -> Array:
    """One robot's row; arguments as of ``Scores``."""
    return np.concatenate([[version, square, count], score])


class Scores(NamedTuple):
    """What n robots have told of how poses fit their samples.

    Attributes:
        versions: Of the poses that each score is at, shape (n,).
        squares: Mean squares of the residuals, in units of what noise leaves in them, shape (n,).
        counts: Numbers of samples, shape (n,).
        scores: Derivatives of the log-likelihood by the perturbation of the own pose, shape (n, 6).
    """

    versions: Array
    squares: Array
    counts: Array
    scores: Array

    @staticmethod
    def of(rows: Array) -> Scores:
        """Of rows (n, 9)."""
        return Scores(rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3:])


class Fit(NamedTuple):
    """What the reference robot has found; all rows but for their pose are alike.

    Attributes:
        since: Block from which on the poses count.
        again_before: Samples from before this block go through sums again, if any do.
        has_prior: Whether what a former team knew of poses is in them.
        are_noisy: Whether the samples cannot all be true: then the poses are those from before.
        poses: Of all robots.
    """

    since: float
    again_before: float
    has_prior: bool
    are_noisy: bool
    poses: tuple[Pose, ...]

    def rows(self) -> Array:
        """One for each robot, shape (N, 16)."""
        common = [self.since, self.again_before, float(self.has_prior), float(self.are_noisy)]
        return np.array([[*common, *pose.numbers()] for pose in self.poses])

    @staticmethod
    def of(rows: Array) -> Fit:
        """Inverse of ``rows``. Somebody's memory may have got any number wrong, see ``is_possible``."""
        since, again_before, has_prior, are_noisy = rows[0, :4].tolist()
        poses = tuple(Pose.of_numbers(row[4:]) for row in rows)
        return Fit(since, again_before, bool(has_prior), bool(are_noisy), poses)

    @property
    def is_possible(self) -> bool:
        """Whether it can be one."""
        return self.since >= self.again_before and all(map(Pose.is_rigid, self.poses))
