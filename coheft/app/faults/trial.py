"""Running one schedule with all checks."""

import time
from collections.abc import Iterable, Iterator

import msgspec

from coheft.app.faults.invariants import Violation, Watch
from coheft.app.faults.lasting import is_undeclared, lasting_kinds
from coheft.app.faults.recovery import Recovery
from coheft.app.faults.run import FaultyBlock, FaultyRun
from coheft.app.faults.schedule import FaultSchedule, Lie, is_harmless
from coheft.app.faults.unlike import unlike_kinds
from coheft.errors import SimulationError
from coheft.wire.messages.codec import encode


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of one schedule.

    Attributes:
        faults: Kinds of its faults, including lasting ones.
        last: Kind of the fault that ended last; empty if there was none.
        simulated: Simulated time [s].
        violations: Broken promises. If sensor errors exceed the known tolerances, only P2 is promised.
        undeclared: Whether sensor errors exceed the known tolerances.
        off_for: Longest time for which a robot reported wrong numbers as valid [s]; None if it never did.
        first_valid: When all were valid for the first time [s]; None if never.
        recovered: Time from the end of all faults and load changes until all were valid [s]; None if they were not.
        stale: Share of published estimates that were stale.
        named: Number of agents that lied and that another agent named in a reason or a problem.
        lost: Why the robots lost the payload; the run then ended early, and was checked up to there.
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
    undeclared: bool = False
    off_for: float | None = None
    lost: str = ""
    took: float = 0.0


def try_schedule(schedule: FaultSchedule) -> Outcome:
    """Run a schedule until its end, or until all robots have recovered for good, and check every promise."""
    began = time.perf_counter()
    run = FaultyRun(schedule)
    watch, recovery, check = Watch(schedule, run.scene), Recovery(schedule), _HarmlessCheck(schedule, run)
    lies = [fault for fault in schedule.faults if isinstance(fault, Lie)]
    named: set[str] = set()
    simulated, lost, undeclared = 0.0, "", is_undeclared(schedule.scenario)
    try:
        for block in run:
            simulated = block.truth.time
            watch.look(block)
            recovery.look(block)
            named |= _named(lies, block)
            check.look(block)
            if recovery.is_steady and not undeclared:  # effects of a lasting sensor error may show late
                break
    except SimulationError as error:
        lost = str(error)
    violations = [violation for violation in watch.violations if not undeclared or violation.promise == "P2"]
    if not lost and not undeclared:
        violations += filter(None, [recovery.violation()])
    violations += filter(None, [check.violation])
    last = max(schedule.faults, key=lambda fault: fault.end, default=None)
    return Outcome(
        seed=schedule.seed,
        faults=(
            *(fault.kind for fault in schedule.faults),
            *lasting_kinds(schedule.scenario),
            *unlike_kinds(schedule.scenario),
        ),
        last=last.kind if last is not None else "",
        simulated=simulated,
        violations=violations,
        first_valid=recovery.first_valid,
        recovered=recovery.taken,
        stale=recovery.stale / max(1, recovery.published),
        refused=run.network.refused,
        lied=len({lie.robot for lie in lies}),
        named=len(named),
        undeclared=undeclared,
        off_for=watch.off_for,
        lost=lost,
        took=time.perf_counter() - began,
    )


class _HarmlessCheck:
    """Compares a run with a second one without harmless messages, which starts when they begin; keeps the first
    difference.
    """

    def __init__(self, schedule: FaultSchedule, run: FaultyRun) -> None:
        harmless = [fault for fault in schedule.faults if is_harmless(fault)]
        block_duration = schedule.scenario.block_duration
        self._first = min((int(fault.start / block_duration) for fault in harmless), default=-1)
        self._run = run
        self._without: Iterator[FaultyBlock] | None = None
        self.violation: Violation | None = None
        self._begin()

    def look(self, block: FaultyBlock) -> None:
        """Compare the estimates that were published after a block."""
        if self._without is not None and _published(next(self._without)) != _published(block):
            text = "estimates differ from those without the harmless messages"
            self.violation = self.violation or Violation("P2", block.truth.time, "", text)
        self._begin()

    def _begin(self) -> None:
        if self._run.next_block == self._first:
            self._without = iter(self._run.without_harmless())


def _published(block: FaultyBlock) -> bytes:
    """Return all estimates after a block as bytes, without the number of refused messages."""
    estimates = [outbox.estimate for _, outbox in sorted(block.outboxes.items()) if outbox.estimate is not None]
    return b"".join(encode(msgspec.structs.replace(estimate, problems=0), "") for estimate in estimates)


def _named(lies: Iterable[Lie], block: FaultyBlock) -> set[str]:
    """Return the lying agents that another agent names after a block, in a reason or a problem."""
    named = set()
    for lie in lies:
        for robot, outbox in block.outboxes.items():
            texts = [*outbox.problems, *(outbox.estimate.reasons if outbox.estimate is not None else ())]
            if block.truth.time >= lie.start and robot != lie.robot and any(lie.robot in text for text in texts):
                named.add(lie.robot)
    return named
