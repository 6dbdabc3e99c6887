"""The watch: what it calls a broken promise, on estimates that are made up from the truth."""

from __future__ import annotations

from functools import cache

import msgspec
import numpy as np
import pytest

from coheft.agents.agent import Outbox
from coheft.app.faults.invariants import Violation, Watch
from coheft.app.faults.recovery import BACK, BACK_FROM_SILENCE, Recovery
from coheft.app.faults.run import FaultyBlock
from coheft.app.faults.schedule import AnyFault, Crash, FaultSchedule, Lie, Loss, Release
from coheft.app.results.judge import Judge
from coheft.estimation.geometry.body_motion import perturbed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import unpack_symmetric
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.structs import Estimate, NeighbourMessage, PayloadEstimate, PoseEstimate, Reference, Validity
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.schema import LoadChange
from tests.faults.drawn import plain

DEVIATION = 0.001
BLOCK = 0.1


def schedule(*faults: AnyFault, changes: tuple[LoadChange, ...] = ()) -> FaultSchedule:
    drawn = plain(1)
    sensors = msgspec.structs.replace(drawn.scenario.sensors, rate=100, block=10)
    scenario = msgspec.structs.replace(drawn.scenario, load_changes=changes, duration=10.0, sensors=sensors)
    return msgspec.structs.replace(drawn, faults=faults, scenario=scenario)


class Team:
    """Truths of a run, and estimates that are off by what is asked for."""

    def __init__(self, run: FaultSchedule) -> None:
        simulation = Simulation(run.scenario)
        self.scene: Scene = simulation.scene
        self.truths: list[Truth] = [simulation.advance({}).truth for _ in range(run.scenario.blocks)]
        self.judge = Judge(self.scene, self.truths)

    def estimate(
        self,
        block: int,
        robot: str = "r1",
        *,
        off: Array | None = None,
        pose_off: Array | None = None,
        status: str = "valid",
        valid_block: int | None = None,
        covariance: Array | None = None,
    ) -> Estimate:
        of = block if valid_block is None else valid_block
        truth, errors = self.judge.payload(robot, of), np.zeros(10) if off is None else off * DEVIATION
        other = next(name for name in self.scene.robots if name != robot)
        pose = self.judge.relative_pose(robot, other)
        payload = PayloadEstimate(
            truth.mass + errors[0],
            truth.com + errors[1:4],
            truth.tensor + unpack_symmetric(errors[4:]),
            DEVIATION**2 * np.eye(10) if covariance is None else covariance,
        )
        moved = pose if pose_off is None else perturbed(pose, pose_off * DEVIATION)
        return Estimate(
            robot=robot,
            block=block,
            time=(block + 1) * BLOCK,
            phase="inertia",
            converged=True,
            members=3,
            payload=payload,
            poses={other: PoseEstimate(moved.rotation, moved.translation, DEVIATION**2 * np.eye(6))},
            total_block=block,
            total_wrench=np.zeros(6),
            not_observable=[],
            load_changes=[],
            status=Validity(status),
            valid_block=of,
        )

    def block(self, number: int, *estimates: Estimate, crashes: dict[str, Exception] | None = None) -> FaultyBlock:
        message = NeighbourMessage(sender="r1", block=number, gossip=[], channels={})
        reference = Reference(robot="r1", block=number, answers=number, motion=np.zeros((10, 12)), wrench=np.zeros(6))
        outboxes = {estimate.robot: Outbox(message, reference, estimate) for estimate in estimates}
        return FaultyBlock(number, self.truths[number], outboxes, crashes or {})


@cache
def team_of(changes: tuple[LoadChange, ...]) -> Team:
    """Faults make no difference to it."""
    return Team(schedule(changes=changes))


def violations(run: FaultSchedule, number: int = 20, **made_up: object) -> list[Violation]:
    """Of a run in which r1 publishes one estimate, after that block."""
    team = team_of(run.scenario.load_changes)
    watch = Watch(run, team.scene)
    for block in range(number):
        watch.check(team.block(block))
    watch.check(team.block(number, team.estimate(number, **made_up)))  # type: ignore[arg-type]
    return watch.violations


def one(index: int, size: float, count: int = 10) -> Array:
    return size * np.eye(count)[index]


@pytest.mark.slow
def test_five_standard_deviations_are_the_limit_for_every_number():
    numbers = [("off", index, 10) for index in range(10)] + [("pose_off", index, 6) for index in range(6)]
    for what, index, count in numbers:
        for sign in (-1.0, 1.0):
            assert violations(schedule(), **{what: one(index, 4.9 * sign, count)}) == []
            (found,) = violations(schedule(), **{what: one(index, 5.1 * sign, count)})
            assert (found.promise, found.robot, round(found.size, 6)) == ("P1", "r1", 5.1)
    (found,) = violations(schedule(), pose_off=one(4, 5.1, 6))
    assert found.what.startswith("pose of r2: position y off by 0.0051")


def test_what_is_not_called_valid_may_be_wrong():
    for status in ("starting", "stale"):
        assert violations(schedule(), off=one(0, 1000.0), status=status) == []


def test_covariances_must_be_positive_and_payloads_possible():
    negative = DEVIATION**2 * np.eye(10)
    negative[1, 2] = negative[2, 1] = 1.1 * DEVIATION**2
    for covariance, words in (
        (negative, "not positive"),
        (np.zeros((10, 10)), "no covariance"),
        (np.nan * negative, "no"),
    ):
        (found,) = violations(schedule(), covariance=covariance)
        assert words in found.what
    (found, *_) = violations(schedule(), off=one(0, -20000.0))
    assert found.what == "payload cannot exist"


def test_a_change_of_the_load_must_be_known_after_the_time_of_grace():
    """What is published is the payload of the block before the change."""
    run = schedule(changes=(LoadChange(at=1.0, mass=2.0),))
    team = team_of(run.scenario.load_changes)
    old = team.estimate(9).payload
    assert old is not None

    def found(valid_block: int) -> list[Violation]:
        watch = Watch(run, team.scene)
        for block in range(20):
            watch.check(team.block(block))
        stays = msgspec.structs.replace(team.estimate(20, valid_block=valid_block), payload=old)
        watch.check(team.block(20, stays))
        return watch.violations

    assert found(9) == found(12) == []
    assert [violation.promise for violation in found(13)] == ["P1"]


def test_a_load_that_leaks_is_compared_with_what_is_left_of_it():
    run = schedule(changes=(LoadChange(at=1.0, mass=2.0, leak=0.5),))
    team = team_of(run.scenario.load_changes)
    watch = Watch(run, team.scene)
    for block in range(80):
        watch.check(team.block(block, team.estimate(block)))
    assert watch.violations == []
    full = team.estimate(15).payload
    watch.check(team.block(80, msgspec.structs.replace(team.estimate(80), payload=full)))
    assert [violation.promise for violation in watch.violations] == ["P1"]


def test_poses_of_those_who_let_go_and_words_of_liars_are_not_judged():
    assert violations(schedule(Release(start=1.0, end=3.0, robot="r2")), pose_off=one(4, 50.0, 6)) == []
    assert violations(schedule(Lie(start=1.0, end=1.5, robot="r1", how="garbage", size=1.0)), off=one(0, 50.0)) == []
    assert violations(schedule(Lie(start=1.0, end=1.5, robot="r2", how="garbage", size=1.0)), off=one(0, 50.0)) != []
    twice = (Lie(start=start, end=start + 0.5, robot="r1", how="garbage", size=1.0) for start in (1.0, 4.0))
    assert violations(schedule(*twice), off=one(0, 50.0)) == []


def test_an_exception_is_a_broken_promise():
    run = schedule()
    team = team_of(run.scenario.load_changes)
    watch = Watch(run, team.scene)
    watch.check(team.block(0, crashes={"r2": ValueError("no such thing")}))
    (found,) = watch.violations
    assert (found.promise, found.robot, found.what) == ("P2", "r2", "raised ValueError: no such thing")


def recovered(run: FaultSchedule, valid: float, again: float) -> tuple[float | None, list[Violation]]:
    """All are valid from one time on, not during faults, and again from another time on."""
    team = team_of(run.scenario.load_changes)
    recovery = Recovery(run)
    for block in range(run.scenario.blocks):
        time = (block + 1) * BLOCK
        faulty = any(fault.is_active(time) for fault in run.faults)
        is_valid = valid - 1e-9 <= time and not faulty and not (run.last_fault_end <= time < again - 1e-9)
        status = "valid" if is_valid else "stale"
        recovery.add(team.block(block, *(team.estimate(block, name, status=status) for name in team.scene.robots)))
    return recovery.taken, [violation for violation in [recovery.violation()] if violation is not None]


@pytest.mark.parametrize(
    ("fault", "limit"),
    [
        (Crash(start=2.0, end=3.0, robot="r1"), BACK_FROM_SILENCE),
        (Loss(start=2.0, end=3.0, probability=0.5), BACK),
    ],
)
def test_all_must_be_valid_again_in_time(fault: AnyFault, limit: float):
    taken, found = recovered(schedule(fault), 1.0, 3.0 + limit)
    assert taken == pytest.approx(limit)
    assert found == []
    _, found = recovered(schedule(fault), 1.0, 3.0 + limit + BLOCK)
    assert [violation.promise for violation in found] == ["P3"]
    taken, found = recovered(schedule(fault), 1.0, 99.0)
    assert taken is None
    assert [violation.promise for violation in found] == ["P3"]


def test_a_run_is_over_when_all_have_long_been_valid_and_nothing_is_to_come():
    run = schedule(Loss(start=2.0, end=3.0, probability=0.5), changes=(LoadChange(at=4.0, mass=1.0),))
    team, recovery = team_of(run.scenario.load_changes), Recovery(run)
    steady = []
    for block in range(run.scenario.blocks):
        status = "stale" if block == 50 else "valid"  # 5.1 s
        recovery.add(team.block(block, *(team.estimate(block, name, status=status) for name in team.scene.robots)))
        steady.append(recovery.is_steady)
    assert steady.index(True) == 76  # 2.5 s later
    assert recovery.taken == pytest.approx(0.0)  # stale for a moment only, 1.1 s after


def test_who_has_not_noticed_yet_what_is_wrong_is_not_valid_again():
    run = schedule(Loss(start=2.0, end=3.0, probability=0.5))
    team, recovery = team_of(run.scenario.load_changes), Recovery(run)
    for block in range(run.scenario.blocks):
        status = "stale" if 38 <= block < 60 else "valid"  # 3.9 s to 6.1 s
        recovery.add(team.block(block, *(team.estimate(block, name, status=status) for name in team.scene.robots)))
    assert recovery.taken == pytest.approx(3.1)
