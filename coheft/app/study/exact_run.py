"""The truth of a run, and the Cramér-Rao bounds of its estimates."""

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.app.results.quantities import Edges, TeamArrays
from coheft.app.study.samples import TeamSamples
from coheft.estimation.bounds import JointBound, JointInformation
from coheft.estimation.measurement import GYRO, KINEMATICS, WRENCH
from coheft.wire.scenario.schema import Scenario

_NO_SENSOR = 1e6
"""Noise of a sensor that is missing, so large that it shows nothing [N, N·m]."""
_BOUND_RATE = 100
"""Samples per second used to integrate information over time; motions are much slower."""


class ExactRun:
    """A run with the samples of exact sensors, for computing bounds with the scenario's noise and errors."""

    def __init__(self, scenario: Scenario, exact: TeamSamples, edges: Edges) -> None:
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
        w, forces = exact.samples[:, :, GYRO], self._wrenches[:, :, :3]
        first_of_force = np.gradient(forces, 1.0 / rate, axis=0) + np.cross(w, forces)
        second = np.gradient(first_of_force, 1.0 / rate, axis=0) + np.cross(w, first_of_force)
        self._flexing = np.concatenate([first_of_force, second], axis=2)
        self._step = max(1, scenario.sensors.rate // _BOUND_RATE)

    def information(self, first: int, end: int) -> JointInformation:
        """Return the information of all sensors in the blocks from ``first`` up to ``end``, in which the load is
        constant.
        """
        block, step, names = self._scenario.sensors.block, self._step, self._judge.scene.robots
        chosen = np.arange(first * block + step // 2, end * block, step)
        # Every chosen sample stands for ``step`` samples.
        sensors, factor = self._scenario.robot_sensors(), (_long_term_variance(self._scenario) / step) ** 0.5
        noises = [
            msgspec.structs.replace(own.noise, **dict.fromkeys(own.missing, _NO_SENSOR)).scaled(factor)
            for own in sensors
        ]
        tolerances = [own.tolerance for own in sensors]
        payload = self._judge.payload(names[0], end - 1)
        motion, wrenches = self._motion[chosen], self._wrenches[chosen]
        motion_rates, wrench_rates = (each[chosen] for each in self._rates)
        rates = motion_rates, wrench_rates, self._flexing[chosen]
        return JointInformation.of(self._poses, payload, motion, wrenches, noises, tolerances, rates)

    def seen(self, bound: JointBound) -> TeamArrays:
        """Return the smallest possible covariances in the coordinates of all robots."""
        names = self._judge.scene.robots
        return TeamArrays(
            poses=np.array([bound.relative_pose(names.index(i), names.index(j)) for i, j in self._edges]),
            payload=np.array([bound.inertia_seen_from(k) for k in range(len(names))]),
        )


def _long_term_variance(scenario: Scenario) -> float:
    """Return the variance of correlated noise over long times, relative to white noise of the same variance."""
    sensors = scenario.sensors
    if sensors.noise_correlation == 0.0:
        return 1.0
    return 1.0 / float(np.tanh(0.5 / (sensors.noise_correlation * sensors.rate)))
