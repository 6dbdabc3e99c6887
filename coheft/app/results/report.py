"""The results of a run in one struct, which becomes the JSON report; ``docs/json-report.md`` describes all of it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np

from coheft.app.outputs import write_text
from coheft.app.results.judge import Matrix, RobotReport, Verdict
from coheft.app.results.record import EstimatorUse, Record
from coheft.app.results.robot_record import HistoryPoint, LoadPeriod
from coheft.app.results.slips import SlipReport
from coheft.errors import CoheftError
from coheft.wire.former_names import present
from coheft.wire.scenario.schema import Scenario


class PayloadReport(msgspec.Struct, frozen=True):
    """True mass [kg], centre of mass [m] and inertia about it [kg·m²] in the payload's frame."""

    mass: float
    com: list[float]
    inertia: Matrix


class LoadChangeReport(msgspec.Struct, frozen=True):
    """A load that was added or removed.

    Attributes:
        leak_kg_s: Total leak rate of the loads from then on [kg/s]; the robots have to recover the payload as it
            changes.
        detected_at_s: Time at which the last robot had noticed the change [s]; None if some never did.
        recovered_at_s: Time from which every robot's mass was within 3 % and centre of mass within 20 mm, for 1 s or
            until it restarted, or the next change or the end came [s]; None if there is none.
        before_change: Each robot's estimate just before.
        noticed_at_s: When each robot first noticed a change, between this one and the next [s]; a robot that did not is
            missing.
    """

    at_s: float
    truth: PayloadReport
    leak_kg_s: float
    detected_at_s: float | None
    recovered_at_s: float | None
    before_change: dict[str, RobotReport]
    noticed_at_s: dict[str, float] = {}


class ConsensusReport(msgspec.Struct, frozen=True):
    """RMS errors of the total wrench in phase ``inertia``, relative to the RMS truth; None if that phase was not
    reached.
    """

    force_rel_error: float | None
    torque_rel_error: float | None


class CarryPhaseReport(msgspec.Struct, frozen=True):
    """How the load was carried during a phase, in root mean squares.

    Attributes:
        what: ``alone``: each robot moved independently; ``springs``: along the common path, without feed-forward;
            ``feedforward``: with it.
        position_rms_mm: Distance of the payload's frame from the path [mm]; None if there was no path.
        rotation_rms_deg: Angle between the payload's frame and the path [degrees]; None if there was no path.
        internal_force_rms_n: Internal force per robot: measured forces that do not move the load [N].
        internal_torque_rms_nm: Internal torque per robot [N·m].
    """

    what: Literal["alone", "springs", "feedforward"]
    from_s: float
    to_s: float
    position_rms_mm: float | None
    rotation_rms_deg: float | None
    internal_force_rms_n: float
    internal_torque_rms_nm: float


class LoadDropReport(msgspec.Struct, frozen=True):
    """Deviation from the path after a load change.

    Attributes:
        mass: Mass of the payload from then on [kg].
        largest_mm: Largest distance from the path since then [mm].
        back_after_s: Time from the change to the last moment, before the next change, at which the load was farther
            from the path than a fifth of its RMS distance in the first phase ``springs`` [s]; 0 if it never was. None
            without feed-forward, without such a phase, or if no phase continued after that moment: the load was still
            that far away at the end, or the run ended within 2 s of the change.
    """

    at_s: float
    mass: float
    largest_mm: float
    back_after_s: float | None


class CarryReport(msgspec.Struct, frozen=True):
    """Results of carrying a load, and the internal force and torque that sensor noise alone would cause [N, N·m]."""

    phases: list[CarryPhaseReport]
    drops: list[LoadDropReport]
    noise_force_n: float
    noise_torque_nm: float


class BoundReport(msgspec.Struct, frozen=True):
    """Cramér-Rao bound of a robot's estimate: root mean squares of the errors that are possible, as in its report."""

    mass_pct: float
    com_mm: float
    inertia_pct: float


class Report(msgspec.Struct, frozen=True):
    """The report of a run.

    Attributes:
        estimator: The estimator in use at the end.
        processes: Number of processes: physics server and agents.
        real_time_factor: Simulated time divided by wall time.
        messages_per_s: Messages between processes per second of wall time: for each block one measurement and one
            reference per robot, one message each way along each edge, one truth; and the estimates, about one per robot
            every 0.1 s.
        late_blocks: Number of late references over all robots; only in real time. In spite of its name it does not
            count blocks: if several robots are late for a block, each one counts.
        beside: The same of the estimators that ran beside the robots' own on the same samples, by name.
        bound: The smallest possible error of each robot's estimate at the end, if several estimators ran; None if there
            was one, or the bound of such a run cannot be computed.
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
    beside: dict[str, Report] = {}
    bound: dict[str, BoundReport] | None = None

    @property
    def by_estimator(self) -> dict[str, Report]:
        """The reports of all estimators that ran, by name, the robots' own first."""
        return {self.estimator: self, **self.beside}

    def of_estimator(self, name: str | None) -> Report:
        """Return the report of an estimator, by default the robots' own; a ``CoheftError`` if it did not run."""
        return self.by_estimator[chosen_estimator(name, list(self.by_estimator))]

    @property
    def verdict(self) -> Verdict:
        """Verdict for all robots: the worst of theirs."""
        verdicts = {robot.verdict for robot in self.robots.values()}
        return next(verdict for verdict in Verdict if verdict in verdicts)

    @property
    def converged(self) -> bool:
        """Whether every robot has converged, without contradictions."""
        return self.verdict is Verdict.CONVERGED


def chosen_estimator(name: str | None, names: Sequence[str]) -> str:
    """Return the estimator whose results are to be used, by default the first; a ``CoheftError`` if it did not run."""
    chosen = names[0] if name is None else present(name)
    if chosen not in names:
        raise CoheftError(f"the estimator {chosen} did not run: there are results of {', '.join(names)}")
    return chosen


def build_report(scenario: Scenario, record: Record, *, real_time_factor: float = 0.0, late_blocks: int = 0) -> Report:
    """Build the report of a run of a scenario from what an observer has recorded: a truth, and estimates of all robots,
    see ``Record.silent``.
    """
    robots = {}
    for name, belief in record.beliefs.items():
        if (report := record.robots[name].report) is not None:
            robots[name] = report.as_of_now(belief)
    neighbours, beside = record.scene.neighbours, record.beside
    estimates = sum(robot.compared for each in (record, *beside.values()) for robot in each.robots.values())
    estimates_per_block = estimates / record.blocks
    messages_per_block = 2 * len(robots) + sum(map(len, neighbours.values())) + estimates_per_block + 1
    return Report(
        scenario=scenario.name,
        seed=scenario.seed,
        estimator=record.estimators[-1].estimator,
        duration_s=record.time,
        robots=robots,
        load_changes=[_load_change(period, list(robots)) for period in record.periods[1:]],
        estimator_changes=record.estimators[1:],
        consensus=_consensus(record),
        processes=len(robots) + 1,
        real_time_factor=real_time_factor,
        messages_per_s=messages_per_block * real_time_factor / scenario.block_duration,
        late_blocks=late_blocks,
        slips=record.slips.reports(record.latest.values()),
        carry=None if record.carried is None else record.carried.report(),
        history={name: robot.history for name, robot in record.robots.items()} if record.with_history else None,
        beside={
            name: build_report(scenario, other, real_time_factor=real_time_factor, late_blocks=late_blocks)
            for name, other in beside.items()
            if not other.silent
        },
    )


def _load_change(period: LoadPeriod, names: Sequence[str]) -> LoadChangeReport:
    """Report a load change. Its time is from the truth, so changes requested during the run are included."""
    truth = period.truth
    return LoadChangeReport(
        at_s=round(period.start, 9),
        truth=PayloadReport(truth.payload.mass, truth.payload.com.tolist(), truth.payload.tensor.tolist()),
        leak_kg_s=sum(load.leak for load in truth.loads if load.mass > 0.0),
        detected_at_s=_last_of([period.noticed.get(name) for name in names]),
        recovered_at_s=_last_of([period.recovered.get(name) for name in names]),
        before_change={name: before for name in names if (before := period.believed_before(name)) is not None},
        noticed_at_s={name: period.noticed[name] for name in names if name in period.noticed},
    )


def _last_of(times: Sequence[float | None]) -> float | None:
    known = [time for time in times if time is not None]
    return max(known) if len(known) == len(times) else None


def _consensus(record: Record) -> ConsensusReport:
    """Compare the robots' total wrenches with the true ones of the same samples."""
    robots = record.robots.values()
    errors = np.sum([robot.wrench_errors for robot in robots], axis=0)
    totals = np.sum([robot.wrench_totals for robot in robots], axis=0)
    if not totals.all():
        return ConsensusReport(None, None)
    force, torque = np.sqrt(errors / totals).tolist()
    return ConsensusReport(force_rel_error=force, torque_rel_error=torque)


def write_report(report: msgspec.Struct, target: str) -> None:
    """Write the report as JSON to a file, or to standard output if it is ``-``; a ``CoheftError`` if that fails."""
    text = msgspec.json.format(msgspec.json.encode(report)).decode() + "\n"
    if target == "-":
        sys.stdout.write(text)
    else:
        write_text(Path(target), text, "the report to ")
