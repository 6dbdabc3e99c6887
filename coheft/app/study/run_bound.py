"""The Cramér-Rao bound of one run, which is shown beside its estimators."""

from itertools import pairwise

import msgspec
import numpy as np

from coheft.app.results.judge import Judge
from coheft.app.results.quantities import QUANTITIES, TeamArrays
from coheft.app.results.record import load_ids
from coheft.app.results.report import BoundReport, Report
from coheft.app.study.exact_run import ExactRun
from coheft.app.study.samples import TeamSamples, simulate, with_exact_sensors
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.schema import Scenario

_MOST_SAMPLES = 300_000
"""Of all robots together: longer runs of larger teams are not simulated again."""
_NEAR = 1e-9
"""Distance of two payloads [m], and of their quaternions, below which their runs were the same."""


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
    return msgspec.structs.replace(report, bound=_reported(exact, exact_run.seen(known.full_bound())))


def _is_same(one: Truth, other: Truth) -> bool:
    return (
        one.block == other.block
        and bool(np.allclose(one.position, other.position, atol=_NEAR))
        and bool(np.allclose(one.quaternion, other.quaternion, atol=_NEAR))
        and bool(np.isclose(one.payload.mass, other.payload.mass))
    )


def _reported(exact: TeamSamples, bounds: TeamArrays) -> dict[str, BoundReport]:
    """Return bounds by robot, in the units of errors in reports."""
    judge = Judge(exact.scene, exact.truths)
    sizes = {
        quantity.name: np.sqrt(quantity.expected_squares(bounds.payload)).tolist()
        for quantity in QUANTITIES
        if quantity.of_payload
    }
    result = {}
    for k, name in enumerate(exact.scene.robots):
        truth = judge.payload(name, exact.truths[-1].block)
        result[name] = BoundReport(
            mass_pct=100.0 * sizes["mass"][k] / truth.mass,
            com_mm=1e3 * sizes["com"][k],
            inertia_pct=100.0 * sizes["inertia"][k] / float(np.linalg.norm(truth.tensor)),
        )
    return result
