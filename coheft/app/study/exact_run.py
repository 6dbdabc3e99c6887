"""The truth of a run, and how well it can be known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.app.results.judge import Judge
from coheft.app.results.quantities import Edges, Quantity
from coheft.app.study.samples import TeamSamples
from coheft.estimation.bounds import JointBound, JointInformation
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import KINEMATICS, WRENCH
from coheft.wire.scenario.schema import Scenario

_BOUND_RATE = 100
"""Samples per second with which information is integrated over time; motions are slower by far."""


@dataclass(frozen=True, eq=False)
class Bounds:
    """Smallest covariances as all robots would see them.

    Attributes:
        poses: Of all edges, shape (edges, 6, 6).
        payload: Of all robots, shape (N, 10, 10).
    """

    poses: Array
    payload: Array

    def of(self, quantity: Quantity) -> Array:
        """The covariances that ``quantity`` is about."""
        return self.payload if quantity.of_payload else self.poses


class ExactRun:
    """A run seen by sensors without errors.

    Args:
        scenario: With the errors of the real sensors.
        exact: The samples of exact ones.
        edges: Which relative poses are asked for.
        samples_per_second: With which information is integrated, whatever the sensors' rate is.
    """

    def __init__(
        self, scenario: Scenario, exact: TeamSamples, edges: Edges, samples_per_second: int = _BOUND_RATE
    ) -> None:
        self._scenario, self._edges = scenario, edges
        self._judge = Judge(exact.scene, exact.truths)
        self._wrenches = exact.samples[:, :, WRENCH]
        in_payload = [self._judge.pose_payload_in(name, -1).inverse() for name in exact.scene.robots]
        self._poses = [in_payload[0].inverse() @ pose for pose in in_payload]
        first = exact.samples[:, 0, KINEMATICS]  # the body frame is the first robot's
        rate = scenario.sensors.rate
        slopes = np.gradient(first[:, :3], 1.0 / rate, axis=0)
        self._motion = np.hstack([first, slopes])
        self._rates = tuple(np.gradient(each, 1.0 / rate, axis=0) for each in (self._motion, self._wrenches))
        self._step = max(1, scenario.sensors.rate // samples_per_second)

    def information(self, first: int, end: int) -> JointInformation:
        """What all sensors tell in the blocks from ``first`` up to ``end``, during which the load is the same."""
        block, step, names = self._scenario.sensors.block, self._step, self._judge.scene.robots
        chosen = np.arange(first * block + step // 2, end * block, step)
        # Every sample that was chosen stands for ``step`` of them.
        noise = self._scenario.noise.scaled((_as_much_as_white(self._scenario) / step) ** 0.5)
        payload = self._judge.payload(names[0], end - 1)
        motion, wrenches, tolerance = self._motion[chosen], self._wrenches[chosen], self._scenario.sensors.tolerance
        motion_rates, wrench_rates = (each[chosen] for each in self._rates)
        return JointInformation.of(
            self._poses, payload, motion, wrenches, noise, tolerance, (motion_rates, wrench_rates)
        )

    def seen(self, bound: JointBound) -> Bounds:
        """A bound as all robots see it."""
        names = self._judge.scene.robots
        return Bounds(
            poses=np.array([bound.relative_pose(names.index(i), names.index(j)) for i, j in self._edges]),
            payload=np.array([bound.inertia_seen_from(k) for k in range(len(names))]),
        )


def _as_much_as_white(scenario: Scenario) -> float:
    """How many times the variance of white noise correlated noise is worth, over times that are much longer."""
    sensors = scenario.sensors
    if sensors.noise_correlation == 0.0:
        return 1.0
    return 1.0 / float(np.tanh(0.5 / (sensors.noise_correlation * sensors.rate)))
