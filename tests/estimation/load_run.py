"""A load that changes, as blocks of samples that a team takes of it: what tests of its memory are given."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coheft.estimation.bounds import wrench_regressor
from coheft.estimation.inertia import InertiaModel, features, packed_gram
from coheft.estimation.load_samples import Memory
from coheft.estimation.motion_fusion import MotionFusion
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from tests.estimation.fusion import fusion_of
from tests.estimation.team import Team, make_team

RATE, BLOCK = 100, 5
"""Samples per second, and per block: 20 blocks a second."""


class Found(NamedTuple):
    """A change: the first block of the new load, and the newest one when it was found."""

    first_block: int
    last_block: int


class Run:
    """Blocks of a team whose load changes: what fusion makes of their sensors."""

    def __init__(self, seed: int, duration: float, at_rest_until: float = 0.0) -> None:
        self.team: Team = make_team(seed, duration=duration)
        self.fusion: MotionFusion = fusion_of(self.team)
        self.theta = self.team.inertia.barycentric()
        self.model = InertiaModel(self.fusion.wrench_covariance, self.fusion.acceleration_covariance, self.theta)
        self.motion = self.team.motion.copy()
        rest = round(100 * at_rest_until)
        self.motion[:rest] = 0.0
        self.motion[:rest, 6:9] = self.team.motion[0, 6:9]
        self._rng = np.random.default_rng(seed)

    def dropped(self, mass: float) -> Array:
        """``theta`` of a load that lies 0.3 m off."""
        place = Pose(np.eye(3), self.team.inertia.com + [0.3, 0.0, 0.0])
        return Inertia.of_box(mass, (0.1, 0.1, 0.1), place).barycentric()

    def grams(self, thetas: Array, offsets: Array | float = 0.0) -> Array:
        """Packed Gram matrices (n, 190) of all blocks.

        Args:
            thetas: ``theta`` (10,), or one for each sample (n * BLOCK, 10).
            offsets: What sensors read in excess, a wrench for each sample (n * BLOCK, 6).
        """
        bodies = np.broadcast_to(thetas, (len(self.motion), 10))
        exact = np.einsum("nij,nj->ni", wrench_regressor(self.motion), bodies)
        count, rng = len(self.motion), self._rng
        motion = self.motion.copy()
        motion[:, 6:] += rng.multivariate_normal(np.zeros(6), self.fusion.acceleration_covariance, count)
        wrench = exact + offsets + rng.multivariate_normal(np.zeros(6), self.fusion.wrench_covariance, count)
        return np.array([packed_gram(block) for block in features(motion, wrench).reshape(-1, BLOCK, 19)])

    def disturbances(self, size: float) -> Array:
        """What wrenches that swing, with so many times the noise's covariance, add to packed Gram matrices (n, 190)."""
        time = np.arange(len(self.motion)) / RATE
        frequencies, phases = self._rng.uniform(0.4, 1.6, 6), self._rng.uniform(0.0, 2.0 * np.pi, 6)
        swings = np.sqrt(2.0 * size) * np.sin(2.0 * np.pi * frequencies * time[:, None] + phases)
        wrench = swings @ np.linalg.cholesky(self.model.residual_covariance).T
        rows = features(self.motion, np.zeros((len(self.motion), 6))).reshape(-1, BLOCK, 19)
        rows_with = features(self.motion, wrench).reshape(-1, BLOCK, 19)
        return np.array([packed_gram(b) - packed_gram(a) for a, b in zip(rows, rows_with, strict=True)])

    def feed(self, memory: Memory, grams: Array, first: int = 0) -> list[Found]:
        found = []
        for block, gram in enumerate(grams, start=first):
            memory.push(block, gram)
            change = memory.review(self.model)
            if change is not None:
                found.append(Found(change, block))
        return found

    def estimate(self, memory: Memory) -> Array:
        information = memory.information(self.model)
        return np.linalg.solve(information.matrix, information.vector)
