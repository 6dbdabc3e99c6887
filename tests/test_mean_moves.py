"""What robots learn of the noise of the mean of their estimates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.mean_moves import MeanMoves
from coheft.agents.fan2017.network import Network
from coheft.consensus.dynamic import Extrapolation
from coheft.estimation.fan2017.mean_noise import MeanNoise
from coheft.estimation.geometry.spatial import Array, Pose

ROUNDS, MEMORY, DECAY = 8, 10.0, 0.9


@dataclass
class _Estimate:
    """All that is asked of a ``JointRls``."""

    moved: Array
    gain: Array
    decay: float = DECAY

    @property
    def noise_root(self) -> Array:
        return self.gain


def test_a_move_of_the_mean_is_judged_by_the_gain_of_its_time() -> None:
    """Two robots. Consensus takes eight blocks, in which gains change by much; what it tells is of their start."""
    rng, others = np.random.default_rng(1), {"r1": "r2", "r2": "r1"}
    robots = {
        name: MeanMoves(Network(2, {other: 0.5}, 1e-9, Extrapolation(0.0, 0.0, 0.0), knows_lag=True), ROUNDS, MEMORY)
        for name, other in others.items()
    }
    for name, other in others.items():
        robots[name].start({other: Pose.identity()})
    expected, sent = MeanNoise(MEMORY), dict[str, Channels]()
    pulls = rng.normal(size=(60, 2, 10))
    for block, pull in enumerate(pulls):
        gain, inbox, sent = np.exp2(np.cos(block)) * np.eye(10), sent, {}
        for (name, other), own in zip(others.items(), pull, strict=True):
            heard = {other: inbox[other]} if inbox else {}
            robots[name].step(_Estimate(gain @ own, gain), True, heard)  # type: ignore[arg-type]
            sent[name] = robots[name].average.channels()
    for pull in pulls[:-ROUNDS]:
        expected.measure(pull.mean(axis=0), _Estimate(np.zeros(10), np.eye(10)))  # type: ignore[arg-type]
    for robot in robots.values():
        np.testing.assert_allclose(robot.noise.share, expected.share, rtol=1e-9, atol=1e-9)
