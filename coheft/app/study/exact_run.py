"""The truth of a run, and how well it can be known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.app.judge import Judge
from coheft.app.quantities import Edges, Quantity
from coheft.app.study.samples import TeamSamples
from coheft.estimation.bounds import JointBound, joint_bound
from coheft.estimation.centralised import sum_up
from coheft.estimation.measurement import WRENCH
from coheft.estimation.spatial import Array
from coheft.wire.scenario import Scenario

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
    """

    def __init__(self, scenario: Scenario, exact: TeamSamples) -> None:
        self._scenario = scenario
        self._judge = Judge(exact.scene, exact.truths)
        self._wrenches = exact.samples[:, :, WRENCH]
        in_payload = [self._judge.pose_payload_in[name].inverse() for name in exact.scene.robots]
        self._poses = [in_payload[0].inverse() @ pose for pose in in_payload]
        sensors = scenario.sensors
        self._motion = sum_up(exact.samples, self._poses, sensors.noise, sensors.rate).motion

    def bounds(
        self,
        edges: Edges,
        blocks: int,
        load_since: int = 0,
        poses_from_wrenches: bool = False,
        samples_per_second: int = _BOUND_RATE,
    ) -> Bounds:
        """Bounds at some moment of the run.

        Args:
            edges: Which relative poses are asked for.
            blocks: All samples of so many blocks are known.
            load_since: The block with which the load came that lies there.
            poses_from_wrenches: See ``joint_bound``.
            samples_per_second: With which information is integrated, whatever the sensors' rate is.
        """
        names, sensors = self._judge.scene.robots, self._scenario.sensors
        step = max(1, sensors.rate // samples_per_second)
        chosen = np.arange(step // 2, blocks * sensors.block, step)
        bound: JointBound = joint_bound(
            self._poses,
            self._judge.payload(names[0], blocks - 1),
            self._motion[chosen],
            self._wrenches[chosen],
            # Every sample that was chosen stands for ``step`` of them.
            self._scenario.noise.scaled(step**-0.5),
            wrench_from=int(np.searchsorted(chosen, load_since * sensors.block)),
            poses_from_wrenches=poses_from_wrenches,
        )
        return Bounds(
            poses=np.array([bound.relative_pose(names.index(i), names.index(j)) for i, j in edges]),
            payload=np.array([bound.inertia_seen_from(k) for k in range(len(names))]),
        )
