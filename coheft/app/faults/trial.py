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
    watch, recovery = Watch(schedule, run.scene), Recovery(schedule)
    lies = [fault for fault in schedule.faults if isinstance(fault, Lie)]
    named: set[str] = set()
    differences: list[Violation] = []
    simulated, lost, undeclared = 0.0, "", is_undeclared(schedule.scenario)
    try:
        for block, without_harmless in _beside(schedule, run):
            simulated = block.truth.time
            watch.check(block)
            recovery.add(block)
            named |= _named(lies, block)
            if without_harmless is not None and _published(next(without_harmless)) != _published(block):
                text = "estimates differ from those without the harmless messages"
                differences.append(Violation("P2", block.truth.time, "", text))
            if recovery.is_steady and not undeclared:  # effects of a lasting sensor error may show late
                break
    except SimulationError as error:
        lost = str(error)
    violations = [violation for violation in watch.violations if not undeclared or violation.promise == "P2"]
    if not lost and not undeclared:
        violations += filter(None, [recovery.violation()])
    violations += differences[:1]
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


def _beside(schedule: FaultSchedule, run: FaultyRun) -> Iterator[tuple[FaultyBlock, Iterator[FaultyBlock] | None]]:
    """Yield the blocks of a run, and from the first harmless message on a copy of it, without these messages."""
    harmless = [fault for fault in schedule.faults if is_harmless(fault)]
    first = min((int(fault.start / schedule.scenario.block_duration) for fault in harmless), default=-1)
    blocks, copy = iter(run), None
    while run.next_block < schedule.scenario.blocks:
        if run.next_block == first:
            copy = iter(run.without_harmless())
        yield next(blocks), copy


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
