"""What came out of a run, in one struct that becomes the JSON report."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np

from coheft.app.judge import Judge, Matrix, RobotReport
from coheft.errors import CoheftError
from coheft.wire.messages import Estimate, Scene, Truth


class PayloadReport(msgspec.Struct, frozen=True):
    """True mass [kg], centre of mass [m] and inertia there [kg·m²] in the payload's frame."""

    mass: float
    com: list[float]
    inertia: Matrix


class LoadChangeReport(msgspec.Struct, frozen=True):
    """A load was put on, or taken away.

    Attributes:
        at_s: When it happened [s].
        truth: The payload right after.
        leak_kg_s: What the loads on it lose from then on [kg/s]; it is this payload, as it becomes, that robots have to
            recover.
        detected_at_s: When the last robot had noticed [s]; None if some never did.
        recovered_at_s: From when on every robot's mass was within 3 % and centre of mass within 20 mm, until the next
            change or the end [s]; None if not.
        before_change: What each robot believed just before.
    """

    at_s: float
    truth: PayloadReport
    leak_kg_s: float
    detected_at_s: float | None
    recovered_at_s: float | None
    before_change: dict[str, RobotReport]


class ConsensusReport(msgspec.Struct, frozen=True):
    """How well the robots know the total wrench in phase ``inertia``: RMS error over RMS truth; None if never there."""

    force_rel_error: float | None
    torque_rel_error: float | None


class HistoryPoint(msgspec.Struct, frozen=True):
    """One robot's errors at one moment; None where it had no estimate."""

    time_s: float
    mass_error_pct: float | None
    com_error_mm: float | None
    inertia_error_pct: float | None


class Report(msgspec.Struct, frozen=True):
    """The report of a run.

    Attributes:
        scenario: Its name.
        seed: Of sensors' noise and robots' motions.
        estimator: The method.
        duration_s: Simulated time [s].
        robots: What each robot believes at the end.
        load_changes: What happened to the payload.
        consensus: Errors of the total wrench.
        processes: Physics server and agents.
        real_time_factor: Simulated time over wall time.
        messages_per_s: Messages between processes per second of wall time: for each block one measurement and one
            reference per robot, one message each way along each edge, one truth; and the estimates that were kept,
            about one per robot every 0.1 s.
        late_blocks: References that came too late, in real time only, summed over robots.
        history: Errors about once a second, if asked for.
    """

    scenario: str
    seed: int
    estimator: str
    duration_s: float
    robots: dict[str, RobotReport]
    load_changes: list[LoadChangeReport]
    consensus: ConsensusReport
    processes: int
    real_time_factor: float
    messages_per_s: float
    late_blocks: int
    history: dict[str, list[HistoryPoint]] | None = None

    @property
    def converged(self) -> bool:
        """Every robot ended with an estimate that it calls good enough."""
        return all(robot.converged for robot in self.robots.values())


@dataclass(frozen=True)
class RunInfo:
    """What the report says about the run itself.

    Attributes:
        scenario: Name of the scenario.
        seed: Of the run.
        estimator: Method of the agents.
        block_duration: Duration of a block [s].
        real_time_factor: Simulated time over the wall time for which the clock ran.
        late_blocks: As in the report.
    """

    scenario: str
    seed: int
    estimator: str
    block_duration: float
    real_time_factor: float
    late_blocks: int = 0


def build_report(
    info: RunInfo,
    scene: Scene,
    truths: Sequence[Truth],
    estimates: Mapping[str, Sequence[Estimate]],
    *,
    with_history: bool = False,
) -> Report:
    """Compare what the robots believed with the truth.

    Args:
        info: About the run.
        scene: Who holds the payload where.
        truths: In order of blocks, at least one.
        estimates: By robot of the scene, each in order of blocks.
        with_history: Add errors about once a second.

    Raises:
        ValueError: There is no truth, or a robot without any estimate.
    """
    if not truths:
        raise ValueError("a report needs at least one truth")
    silent = [name for name in scene.robots if not estimates.get(name)]
    if silent:
        raise ValueError(f"a report needs an estimate of every robot, there is none of {', '.join(silent)}")
    judge = Judge(scene, truths)
    estimates = {name: estimates[name] for name in scene.robots}  # sums depend on the order, in their last digit
    robots = len(scene.robots)
    estimates_per_block = sum(len(series) for series in estimates.values()) / len(truths)
    messages_per_block = 2 * robots + sum(map(len, scene.neighbours.values())) + estimates_per_block + 1
    return Report(
        scenario=info.scenario,
        seed=info.seed,
        estimator=info.estimator,
        duration_s=truths[-1].time,
        robots={name: judge.robot(series) for name, series in estimates.items()},
        load_changes=_load_changes(judge, info.block_duration, estimates),
        consensus=_consensus(judge, estimates),
        processes=robots + 1,
        real_time_factor=info.real_time_factor,
        messages_per_s=messages_per_block * info.real_time_factor / info.block_duration,
        late_blocks=info.late_blocks,
        history={name: _history(judge, series) for name, series in estimates.items()} if with_history else None,
    )


def _same_loads(first: Truth, second: Truth) -> bool:
    """Whether nothing was put on or taken away; a load that leaks stays the same load."""
    return [load.id for load in first.loads] == [load.id for load in second.loads]


def _load_changes(
    judge: Judge, block_duration: float, estimates: Mapping[str, Sequence[Estimate]]
) -> list[LoadChangeReport]:
    """The truth tells when the load changed, so changes asked for in mid-run are reported too."""
    truths = judge.truths
    changed = [new for old, new in pairwise(truths) if not _same_loads(old, new)]
    starts = [truth.time - block_duration for truth in changed]
    ends = [*starts[1:], np.inf][: len(starts)]
    reports = []
    for truth, start, end in zip(changed, starts, ends, strict=True):
        before = {name: [e for e in series if e.block < truth.block] for name, series in estimates.items()}
        during = [[e for e in series if e.block >= truth.block and e.time <= end] for series in estimates.values()]
        reports.append(
            LoadChangeReport(
                at_s=round(start, 9),
                truth=PayloadReport(truth.payload.mass, truth.payload.com.tolist(), truth.payload.tensor.tolist()),
                leak_kg_s=sum(load.leak for load in truth.loads if load.mass > 0.0),
                detected_at_s=_last_of([_detected(series, start, end) for series in estimates.values()]),
                recovered_at_s=_last_of([_recovered(judge, series) for series in during]),
                before_change={name: judge.robot(series) for name, series in before.items() if series},
            )
        )
    return reports


def _last_of(times: Sequence[float | None]) -> float | None:
    known = [time for time in times if time is not None]
    return max(known) if len(known) == len(times) else None


def _detected(estimates: Sequence[Estimate], start: float, end: float) -> float | None:
    """When a robot first noticed a change between two times."""
    noticed = [notice.noticed_at for notice in estimates[-1].load_changes]
    return min((time for time in noticed if start < time <= end), default=None)


def _recovered(judge: Judge, estimates: Sequence[Estimate]) -> float | None:
    """Time of the first estimate from which on all are good."""
    since = None
    for estimate in estimates:
        if not judge.recovered(estimate):
            since = None
        elif since is None:
            since = estimate.time
    return since


def _consensus(judge: Judge, estimates: Mapping[str, Sequence[Estimate]]) -> ConsensusReport:
    """Compare the totals that the robots summed up with the true ones of the same samples."""
    errors, totals = [], []
    for name, series in estimates.items():
        for estimate in series:
            truth = judge.total_wrench(name, estimate.total_block)
            if estimate.phase == "inertia" and truth is not None:
                errors.append(estimate.total_wrench - truth)
                totals.append(truth)
    if not errors:
        return ConsensusReport(None, None)
    ratio = [np.linalg.norm(np.array(errors)[:, part]) / np.linalg.norm(np.array(totals)[:, part]) for part in _PARTS]
    return ConsensusReport(force_rel_error=float(ratio[0]), torque_rel_error=float(ratio[1]))


_PARTS = (slice(0, 3), slice(3, 6))


def _history(judge: Judge, estimates: Sequence[Estimate]) -> list[HistoryPoint]:
    points = []
    seconds = 0
    for estimate in estimates:
        if int(estimate.time + 1e-9) > seconds:
            seconds = int(estimate.time + 1e-9)
            robot = judge.robot([estimate])
            points.append(
                HistoryPoint(estimate.time, robot.mass.error_pct, robot.com.error_mm, robot.inertia.error_pct)
            )
    return points


def write_report(report: msgspec.Struct, target: str) -> None:
    """Write the report as JSON to a file, or to standard output if ``target`` is ``-``.

    Raises:
        CoheftError: The file cannot be written.
    """
    text = msgspec.json.format(msgspec.json.encode(report)).decode() + "\n"
    if target == "-":
        sys.stdout.write(text)
        return
    try:
        Path(target).write_text(text)
    except OSError as error:
        raise CoheftError(f"cannot write the report to {target}: {error.strerror}") from error
