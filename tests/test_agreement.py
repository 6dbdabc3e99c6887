"""How far what robots agree on may be from the mean of all estimates."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.agents.estimator import Channels
from coheft.agents.fan2017.agreement import Agreement
from coheft.agents.fan2017.network import Network
from coheft.consensus.dynamic import Extrapolation
from coheft.consensus.graph import convergence_rate, metropolis_matrix
from coheft.estimation.geometry.spatial import Pose

LINE = {"r1": ("r2",), "r2": ("r1", "r3"), "r3": ("r2", "r4"), "r4": ("r3",)}
NAMES = tuple(LINE)


@pytest.mark.parametrize(("noise", "drift"), [(1e-3, 0.0), (1e-3, 0.05), (0.0, 0.05)])
def test_what_is_behind_is_as_large_as_is_said(noise: float, drift: float) -> None:
    """Four estimates that move alike by a drift, and each by itself by noise."""
    rng, rate = np.random.default_rng(1), convergence_rate(metropolis_matrix(LINE))
    robots = {}
    for name, others in LINE.items():
        robots[name] = Agreement(
            Network(4, dict.fromkeys(others, 1.0 / 3.0), rate, Extrapolation(0.0, 0.0, 0.0), knows_lag=True), mass=10.0
        )
        robots[name].start({other: Pose.identity() for other in others})
    thetas = {name: np.concatenate([np.zeros(9), [0.1]]) for name in NAMES}
    off, said, sent = [], [], dict[str, Channels]()
    for block in range(300):
        mean = np.mean(list(thetas.values()), axis=0)
        thetas = {name: theta + drift + noise * rng.normal(size=10) for name, theta in thetas.items()}
        inbox, sent = sent, {}
        for name, others in LINE.items():
            own = thetas[name], np.zeros(10), np.zeros(10), np.zeros((10, 10))
            robots[name].step(own, {other: inbox[other] for other in others if inbox}, has_mixed=True)
            sent[name] = robots[name].average.channels()
            if block > 100:
                off.append(robots[name].agreed.theta - mean)  # of the block before
                said.append(robots[name].agreed.behind)
    assert np.mean(np.square(off)) <= np.mean(np.square(said)) <= 9.0 * np.mean(np.square(off)) + 1e-18
