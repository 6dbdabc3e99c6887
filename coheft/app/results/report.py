"""What came out of a run, in one struct that becomes the JSON report."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from coheft.app.results.judge import Matrix, RobotReport, Verdict
from coheft.app.results.record import EstimatorUse, Record
from coheft.app.results.robot_record import HistoryPoint, LoadPeriod
from coheft.app.results.slips import SlipReport
from coheft.errors import CoheftError


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
        recovered_at_s: From when on every robot's mass was within 3 % and centre of mass within 20 mm, for 1 s or until
            it began anew, or the next change or the end came [s]; None if not.
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


class CarryPhaseReport(msgspec.Struct, frozen=True):
    """How the load was carried for a while, root mean squares.

    Attributes:
        what: ``alone``: each robot moved for itself; ``springs``: along the common path, without feed-forward;
            ``feedforward``: with it.
        from_s: Since when [s].
        to_s: Until when [s].
        position_rms_mm: How far the payload's frame was off the path [mm]; None where there was none.
        rotation_rms_deg: And how far it was turned from it [degrees].
        internal_force_rms_n: What a robot pushed against the others: measured forces that move nothing [N].
        internal_torque_rms_nm: And torques [N·m].
    """

    what: Literal["alone", "springs", "feedforward"]
    from_s: float
    to_s: float
    position_rms_mm: float | None
    rotation_rms_deg: float | None
    internal_force_rms_n: float
    internal_torque_rms_nm: float


class LoadDropReport(msgspec.Struct, frozen=True):
    """What a load change did to the way.

    Attributes:
        at_s: When it happened [s].
        mass: Of the payload since then [kg].
        largest_mm: Largest distance off the path since then [mm].
        back_after_s: Time from the change to the last moment, before the next change, at which the load was farther off
            the path than a fifth of its RMS distance in the first phase ``springs`` [s]; 0 if it never was. None
            without feed-forward, without such a phase, or if no phase went on after that moment: the load still was so
            far off at the end, or the run ended within 2 s of the change.
    """

    at_s: float
    mass: float
    largest_mm: float
    back_after_s: float | None


class CarryReport(msgspec.Struct, frozen=True):
    """How the load was carried.

    Attributes:
        phases: In order of time.
        drops: Load changes.
        noise_force_n: What the noise of the sensors alone would make of the forces against each other [N].
        noise_torque_nm: And of the torques [N·m].
    """

    phases: list[CarryPhaseReport]
    drops: list[LoadDropReport]
    noise_force_n: float
    noise_torque_nm: float


class Report(msgspec.Struct, frozen=True):
    """The report of a run.

    Attributes:
        scenario: Its name.
        seed: Of sensors' noise and robots' motions.
        estimator: The method that was in use at the end.
        duration_s: Simulated time [s].
        robots: What each robot believes at the end.
        load_changes: What happened to the payload.
        estimator_changes: When the robots started again with another estimator, and which.
        consensus: Errors of the total wrench.
        processes: Physics server and agents.
        real_time_factor: Simulated time over wall time.
        messages_per_s: Messages between processes per second of wall time: for each block one measurement and one
            reference per robot, one message each way along each edge, one truth; and the estimates, about one per
            robot every 0.1 s.
        late_blocks: References that came too late, in real time only, over all robots: not blocks, whatever its name
            says. Of a block for which several robots were late each one counts.
        history: Errors about once a second, if asked for.
        carry: How the load was carried, if the scenario has a common path.
        slips: Grasps that slipped.
    """

    scenario: str
    seed: int
    estimator: str
    duration_s: float
    robots: dict[str, RobotReport]
    load_changes: list[LoadChangeReport]
    estimator_changes: list[EstimatorUse]
    consensus: ConsensusReport
    processes: int
    real_time_factor: float
    messages_per_s: float
    late_blocks: int
    history: dict[str, list[HistoryPoint]] | None = None
    carry: CarryReport | None = None
    slips: list[SlipReport] = []

    @property
    def verdict(self) -> Verdict:
        """Of all robots: converged only if every robot is, and none is further off than it claims."""
        verdicts = {robot.verdict for robot in self.robots.values()}
        return next(verdict for verdict in Verdict if verdict in verdicts)

    @property
    def converged(self) -> bool:
        """Every robot converged, and none is further off than it claims."""
        return self.verdict is Verdict.CONVERGED


@dataclass(frozen=True)
class RunInfo:
    """What the report says about the run itself.

    Attributes:
        scenario: Name of the scenario.
        seed: Of the run.
        estimator: Method of the agents, at the end.
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


def build_report(info: RunInfo, record: Record) -> Report:
    """The report of what an observer has recorded.

    Raises:
        ValueError: There is no truth, or a robot of which no estimate could be compared with it.
    """
    if record.truth is None:
        raise ValueError("a report needs at least one truth")
    if record.silent:
        raise ValueError(f"a report needs an estimate of every robot, there is none of {', '.join(record.silent)}")
    robots = {}
    for name, belief in record.beliefs.items():
        if (report := record.robots[name].report) is not None:
            robots[name] = report.as_of_now(belief)
    neighbours = record.scene.neighbours
    estimates_per_block = sum(robot.compared for robot in record.robots.values()) / record.blocks
    messages_per_block = 2 * len(robots) + sum(map(len, neighbours.values())) + estimates_per_block + 1
    return Report(
        scenario=info.scenario,
        seed=info.seed,
        estimator=info.estimator,
        duration_s=record.time,
        robots=robots,
        load_changes=[_load_change(period, list(robots)) for period in record.periods[1:]],
        estimator_changes=record.estimators[1:],
        consensus=_consensus(record),
        processes=len(robots) + 1,
        real_time_factor=info.real_time_factor,
        messages_per_s=messages_per_block * info.real_time_factor / info.block_duration,
        late_blocks=info.late_blocks,
        slips=record.slips.reports(record.latest.values()),
        history={name: robot.history for name, robot in record.robots.items()} if record.with_history else None,
    )


def _load_change(period: LoadPeriod, names: Sequence[str]) -> LoadChangeReport:
    """The truth tells when the load changed, so changes asked for in mid-run are reported too."""
    truth = period.truth
    return LoadChangeReport(
        at_s=round(period.start, 9),
        truth=PayloadReport(truth.payload.mass, truth.payload.com.tolist(), truth.payload.tensor.tolist()),
        leak_kg_s=sum(load.leak for load in truth.loads if load.mass > 0.0),
        detected_at_s=_last_of([period.noticed.get(name) for name in names]),
        recovered_at_s=_last_of([period.recovered.get(name) for name in names]),
        before_change={name: before for name in names if (before := period.believed_before(name)) is not None},
    )


def _last_of(times: Sequence[float | None]) -> float | None:
    known = [time for time in times if time is not None]
    return max(known) if len(known) == len(times) else None


def _consensus(record: Record) -> ConsensusReport:
    """Totals that the robots summed up against the true ones of the same samples."""
    robots = record.robots.values()
    errors = np.sum([robot.wrench_errors for robot in robots], axis=0)
    totals = np.sum([robot.wrench_totals for robot in robots], axis=0)
    if not totals.all():
        return ConsensusReport(None, None)
    force, torque = np.sqrt(errors / totals).tolist()
    return ConsensusReport(force_rel_error=force, torque_rel_error=torque)


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
        Path(target).write_text(text, encoding="utf-8")
    except OSError as error:
        raise CoheftError(f"cannot write the report to {target}: {error.strerror}") from error
