"""One schedule run, watched, and what came out."""

from __future__ import annotations

import time

import msgspec

from coheft.app.faults.invariants import Violation, Watch
from coheft.app.faults.recovery import Recovery
from coheft.app.faults.run import FaultyBlock, FaultyRun
from coheft.app.faults.schedule import FaultSchedule, Lie, is_harmless
from coheft.errors import SimulationError
from coheft.wire.codec import encode

_EFFECT = 2.0
"""So long after the last harmless message it is looked for differences that it made [s]."""


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What came out of one schedule.

    Attributes:
        seed: Of the schedule.
        faults: Kinds of its faults.
        last: Kind of the fault that ended last; empty if there was none.
        simulated: Simulated time [s].
        violations: Of the promises.
        first_valid: When all were valid for the first time [s]; None if never.
        recovered: Time from the end of all faults and changes of the load until all were valid [s]; None if they were
            not.
        stale: Share of published estimates that were stale.
        refused: Number of messages that the codec refused.
        lied: Number of agents that lied,
        named: and of those of them whom another one named as a reason or a problem.
        lost: Why the robots lost the payload; then the run ended early, and is judged up to there.
        took: Wall-clock time [s].
    """

    seed: int
    faults: tuple[str, ...]
    last: str
    simulated: float
    violations: list[Violation]
    first_valid: float | None
    recovered: float | None
    stale: float
    refused: int
    lied: int
    named: int
    lost: str = ""
    took: float = 0.0


def try_schedule(schedule: FaultSchedule) -> Outcome:
    """Run a schedule and check every promise; a second time without harmless messages, if there are any."""
    began = time.perf_counter()
    run = FaultyRun(schedule)
    watch, recovery, names = Watch(schedule, run.scene), Recovery(schedule), _Named(schedule)
    published: list[bytes] = []
    simulated, lost = 0.0, ""
    try:
        for block in run:
            simulated = block.truth.time
            watch.look(block)
            recovery.look(block)
            names.look(block)
            if schedule.has_harmless_messages:
                published.append(_published(block))
    except SimulationError as error:
        lost = str(error)
    violations = watch.violations
    if not lost:
        violations += filter(None, [recovery.violation()])
    if schedule.has_harmless_messages:
        violations += filter(None, [_difference(schedule, published)])
    last = max(schedule.faults, key=lambda fault: fault.end, default=None)
    return Outcome(
        seed=schedule.seed,
        faults=tuple(fault.kind for fault in schedule.faults),
        last=last.kind if last is not None else "",
        simulated=simulated,
        violations=violations,
        first_valid=recovery.first_valid,
        recovered=recovery.taken,
        stale=recovery.stale / max(1, recovery.published),
        refused=run.network.refused,
        lied=names.liars,
        named=names.count,
        lost=lost,
        took=time.perf_counter() - began,
    )


def _published(block: FaultyBlock) -> bytes:
    """All estimates after a block, but for how many messages were refused."""
    estimates = [outbox.estimate for _, outbox in sorted(block.outboxes.items()) if outbox.estimate is not None]
    return b"".join(encode(msgspec.structs.replace(estimate, problems=0), "") for estimate in estimates)


def _difference(schedule: FaultSchedule, published: list[bytes]) -> Violation | None:
    """The first block at which harmless messages have made a difference."""
    quiet = iter(FaultyRun(schedule, harmless=False))
    last = max(fault.end for fault in schedule.faults if is_harmless(fault)) + _EFFECT
    for had in published[: round(last / schedule.scenario.block_duration)]:
        block = next(quiet)
        if _published(block) != had:
            return Violation("P2", block.truth.time, "", "estimates differ from those without the harmless messages")
    return None


class _Named:
    """Which liars others have named while or after they lied."""

    def __init__(self, schedule: FaultSchedule) -> None:
        self._lies = [fault for fault in schedule.faults if isinstance(fault, Lie)]
        self._named: set[str] = set()

    def look(self, block: FaultyBlock) -> None:
        """Take in what was published after a block."""
        for lie in self._lies:
            if lie.robot in self._named or block.truth.time < lie.start:
                continue
            for robot, outbox in block.outboxes.items():
                told = [*outbox.problems, *(outbox.estimate.reasons if outbox.estimate is not None else ())]
                if robot != lie.robot and any(lie.robot in words for words in told):
                    self._named.add(lie.robot)

    @property
    def liars(self) -> int:
        """How many there are."""
        return len({lie.robot for lie in self._lies})

    @property
    def count(self) -> int:
        """How many were named."""
        return len(self._named)
