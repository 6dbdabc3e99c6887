"""The Cramér-Rao bounds of estimates in a run."""

from itertools import pairwise

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.app.results.quantities import QUANTITIES, Edges, TeamArrays
from coheft.app.results.record import load_ids
from coheft.app.results.report import BoundReport, Report
from coheft.app.study.samples import TeamSamples, simulate, with_exact_sensors
from coheft.estimation.bounds import JointBound, JointInformation
from coheft.estimation.measurement import GYRO, KINEMATICS, WRENCH
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario

_NO_SENSOR = 1e6
"""Noise of a sensor that is missing, so large that it shows nothing [N, N·m]."""
_BOUND_RATE = 100
"""Samples per second used to integrate information over time; motions are much slower."""
_MOST_SAMPLES = 300_000
"""Of all robots together: longer runs of larger teams are not simulated again for their report."""
_NEAR = 1e-9
"""Distance of two payloads [m], and of their quaternions, below which their runs were the same."""


class ExactRun:
    """A run with the samples of exact sensors, for computing bounds with the scenario's noise and errors.

    ``judge`` knows the truth of all its blocks.
    """

    def __init__(self, scenario: Scenario, exact: TeamSamples, edges: Edges) -> None:
        self._scenario, self._edges = scenario, edges
        self.judge = Judge(exact.scene, exact.truths)
        self._wrenches = exact.samples[:, :, WRENCH]
        in_payload = [self.judge.pose_payload_in(name, -1).inverse() for name in exact.scene.robots]
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
        block, step, names = self._scenario.sensors.block, self._step, self.judge.scene.robots
        chosen = np.arange(first * block + step // 2, end * block, step)
        # Every chosen sample stands for ``step`` samples.
        sensors, factor = self._scenario.robot_sensors(), (_long_term_variance(self._scenario) / step) ** 0.5
        noises = [
            msgspec.structs.replace(own.noise, **dict.fromkeys(own.missing, _NO_SENSOR)).scaled(factor)
            for own in sensors
        ]
        tolerances = [own.tolerance for own in sensors]
        payload = self.judge.payload(names[0], end - 1)
        motion, wrenches = self._motion[chosen], self._wrenches[chosen]
        motion_rates, wrench_rates = (each[chosen] for each in self._rates)
        rates = motion_rates, wrench_rates, self._flexing[chosen]
        return JointInformation.of(self._poses, payload, motion, wrenches, noises, tolerances, rates)

    def seen(self, bound: JointBound) -> TeamArrays:
        """Return the smallest possible covariances in the coordinates of all robots."""
        names = self.judge.scene.robots
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


def with_bound(report: Report, scenario: Scenario, truth: Truth) -> Report:
    """Return the report of a run with the bound of all estimates at its end, if several estimators ran side by side.

    The run is simulated again, without noise and without agents. There is a bound if the payload ends where it ended
    in the run, with the same loads, so that nothing has happened but what the scenario says; and if motions do not
    depend on estimates, grasps did not slip, and loads did not leak.
    """
    run = msgspec.structs.replace(scenario, duration=report.duration_s, seed=report.seed)
    samples = run.robot_count * report.duration_s * run.sensors.rate
    if not report.beside or samples > _MOST_SAMPLES or run.carry is not None or run.slips:
        return report
    exact = simulate(with_exact_sensors(run))
    if not _is_same(exact.truths[-1], truth) or any(load.leak for each in exact.truths for load in each.loads):
        return report
    borders = [after.block for before, after in pairwise(exact.truths) if load_ids(before) != load_ids(after)]
    exact_run = ExactRun(run, exact, [])
    known, *later = [exact_run.information(first, end) for first, end in pairwise([0, *borders, run.blocks])]
    for new in later:
        known = new + known.with_another_load()
    bounds = exact_run.seen(known.full_bound())
    return msgspec.structs.replace(report, bound=_reported(bounds, exact_run.judge, run.blocks - 1))


def _is_same(one: Truth, other: Truth) -> bool:
    return (
        one.block == other.block
        and bool(np.allclose(one.position, other.position, atol=_NEAR))
        and bool(np.allclose(one.quaternion, other.quaternion, atol=_NEAR))
        and bool(np.isclose(one.payload.mass, other.payload.mass))
    )


def _reported(bounds: TeamArrays, judge: Judge, block: int) -> dict[str, BoundReport]:
    """Return bounds by robot after a block, in the units of errors in reports."""
    sizes = {
        quantity.name: np.sqrt(quantity.expected_squares(bounds.payload)).tolist()
        for quantity in QUANTITIES
        if quantity.of_payload
    }
    result = {}
    for k, name in enumerate(judge.scene.robots):
        truth = judge.payload(name, block)
        result[name] = BoundReport(
            mass_pct=100.0 * sizes["mass"][k] / truth.mass,
            com_mm=1e3 * sizes["com"][k],
            inertia_pct=100.0 * sizes["inertia"][k] / float(np.linalg.norm(truth.tensor)),
        )
    return result
