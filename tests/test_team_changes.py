"""Whole runs in which teams change and messages get lost: valid estimates are true, and soon all are valid again."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest

from coheft.app.faults.invariants import Watch
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import AnyFault, Crash, FaultSchedule, Lie, Loss, Partition, Release, SensorFault
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph, LoadChange, Robots
from tests.in_process import changed, run_with_faults

FROM = 3.5
"""When something happens: all have been valid for a while [s]."""
SOON = 3.0
"""After that time without faults all are valid again [s],"""
AT_ONCE = 1.0
"""or after this, if all poses are known from before [s]."""
NOTICED = 0.35
"""After that time without complete sums no robot is valid any more [s]."""
ROBOTS = ("r1", "r2", "r3", "r4")


class Story:
    """A run of four robots in a line, and what they published.

    No valid estimate was more than five of its own standard deviations off, but for payloads from less than 0.3 s after
    a change of the load (see ``coheft.app.faults.invariants``), and no agent failed.
    """

    def __init__(
        self, duration: float, faults: Sequence[AnyFault], load_changes: tuple[LoadChange, ...] = (), seed: int = 1
    ) -> None:
        scenario = changed("line4", duration=duration, load_changes=load_changes, seed=seed)
        schedule = FaultSchedule(seed=seed, scenario=scenario, faults=tuple(faults))
        run = FaultyRun(schedule)
        watch = Watch(schedule, run.scene)
        self.estimates: dict[str, list[Estimate]] = {name: [] for name in ROBOTS}
        for block in run:
            watch.check(block)
            for name, outbox in block.outboxes.items():
                if outbox.estimate is not None:
                    self.estimates[name].append(outbox.estimate)
        assert watch.violations == []

    def at(self, robot: str, time: float) -> Estimate:
        """What it had published last."""
        return [estimate for estimate in self.estimates[robot] if estimate.time <= time + 1e-9][-1]

    def statuses(self, time: float) -> set[str]:
        return {self.at(name, time).status for name in ROBOTS}


@cache
def started_again(robot: str) -> Story:
    return Story(FROM + 0.5 + SOON, [Crash(robot=robot, start=FROM, end=FROM + 0.5)])


@pytest.mark.parametrize("robot", ["r1", "r3"], ids=["first robot", "in the middle"])
def test_an_agent_that_starts_again_with_an_empty_memory_is_taken_in(robot: str) -> None:
    story = started_again(robot)
    neighbour = "r2"
    assert story.statuses(FROM) == {"valid"}
    silent = story.at(neighbour, FROM + 0.1)
    assert silent.status == "stale"
    assert silent.reasons == [f"{robot} is silent since {FROM + 0.02:.2f} s"]
    # What is told while stale is the last that was valid.
    last_valid = story.at(neighbour, FROM)
    assert silent.valid_block <= round(FROM * 50)
    assert silent.payload is not None
    assert last_valid.payload is not None
    assert silent.payload.mass == pytest.approx(last_valid.payload.mass, rel=1e-2)
    others = [name for name in ROBOTS if name != robot]
    assert {story.at(name, FROM + NOTICED).status for name in others} == {"stale"}
    assert story.at(robot, FROM + 0.6).status == "starting"
    assert story.at(robot, FROM + 0.6).members == 4
    assert story.statuses(FROM + 0.5 + AT_ONCE) == {"valid"}
    assert story.statuses(FROM + 0.5 + SOON) == {"valid"}


@pytest.mark.parametrize("robot", ["r1", "r3"], ids=["first robot", "in the middle"])
def test_an_agent_that_starts_again_gets_to_know_what_its_neighbours_know(robot: str) -> None:
    """On its own it would know the load three times less well from one second of rows as from five."""
    story = started_again(robot)
    payloads = [story.at(name, FROM + 0.5 + AT_ONCE).payload for name in (robot, "r2")]
    mine, other = (np.sqrt(payload.covariance[0, 0]) for payload in payloads if payload is not None)
    assert mine == pytest.approx(other, rel=0.05)


def test_a_robot_that_changes_rows_on_the_way_is_contradicted_by_the_other_way_round() -> None:
    """In a ring; numbers that are off by so little contradict no motion."""
    scenario = changed("ring3", duration=FROM + 1.0, load_changes=(), graph=Graph(kind="ring"))
    lie = Lie(robot="r2", start=FROM, end=FROM + 1.0, seed=1, how="scaled", size=1.0001)
    run = FaultyRun(FaultSchedule(seed=1, scenario=scenario, faults=(lie,)))
    estimates = [block.outboxes[name].estimate for block in run for name in ("r1", "r3")]
    told = [estimate for estimate in estimates if estimate is not None and estimate.time > FROM + 0.1]
    assert told
    for estimate in told:
        assert estimate.status == "stale"
        assert any(reason.startswith("different rows of r1") for reason in estimate.reasons)


@pytest.mark.parametrize("robot", ["r1", "r3"])
def test_a_sensor_that_has_gone_off_when_a_team_begins_anew_is_not_taken_for_another_load(robot: str) -> None:
    """Nobody can know which it is, but those who know what the load was; they tell who has lost it."""
    right_again = FROM + 2.0
    offset = SensorFault(start=FROM + 0.4, end=right_again, robot="r2", sensor="force", how="offset", size=6.0)
    story = Story(right_again + 1.5, [Crash(robot=robot, start=FROM, end=FROM + 0.5), offset])
    for name in ROBOTS:
        said = {what for estimate in story.estimates[name] for what in estimate.reasons}
        assert said & {
            "either the load has changed or the force sensor of r2 has an offset",
            "wrenches fit no load, but would with a constant offset: has a sensor not been tared?",
        }, name
    assert story.statuses(right_again + 1.5) == {"valid"}


@pytest.mark.parametrize(
    ("robot", "notice"), [("r4", 10), ("r1", 0)], ids=["told ahead", "first robot, told at the last moment"]
)
def test_a_robot_lets_go_and_takes_hold_again(robot: str, notice: int) -> None:
    loose_from, back = FROM + 0.2, FROM + 2.0
    story = Story(back + SOON, [Release(robot=robot, start=loose_from, end=back, notice=notice)])
    others = [name for name in ROBOTS if name != robot]
    assert story.statuses(FROM) == {"valid"}  # told a bit later
    # Those who hold the load go on without it.
    for name in others:
        without = story.at(name, back - 0.3)
        assert without.status == "valid"
        assert without.members == 3
        assert robot not in without.poses
    loose = story.at(robot, back - 0.3)
    assert loose.status == "stale"
    assert "the robot does not hold the load" in loose.reasons
    assert story.statuses(back + SOON) == {"valid"}
    assert {story.at(name, back + SOON).members for name in ROBOTS} == {4}
    assert set(story.at(robot, back + SOON).poses) == {"r3" if robot == "r4" else "r2"}


def test_a_team_of_which_all_have_let_go_and_taken_hold_again_begins_anew() -> None:
    grasps = load_scenario("line4").robots.grasps[::3]
    team = TeamInProcess(changed("line4", robots=Robots(grasps=grasps), load_changes=()))
    regrasps = {150: "r2", 151: "r1"}  # r1 hears of r2 in the block in which it takes hold again itself
    statuses = dict[int, str]()
    for block in range(240):
        result, heard = team.measure(), team.received()
        if block in regrasps:
            for holding in (False, True):
                team.agents[regrasps[block]].set_holding(holding, block)
        estimate = team.answer(measured(result), heard)["r1"].estimate
        if estimate is not None:
            statuses[block] = estimate.status
    assert [statuses[block] for block in (149, 151, 239)] == ["valid", "stale", "valid"]


def test_halves_that_cannot_talk_are_stale_until_they_can() -> None:
    healed = FROM + 1.0
    story = Story(healed + SOON, [Partition(group=("r1", "r2"), start=FROM, end=healed)])
    assert story.statuses(FROM) == {"valid"}
    for time in (FROM + NOTICED, healed):
        assert story.statuses(time) == {"stale"}
    assert story.at("r2", healed).reasons[0] == f"r3 is silent since {FROM + 0.02:.2f} s"
    assert story.statuses(healed + SOON) == {"valid"}
    assert {len(estimates[-1].load_changes) for estimates in story.estimates.values()} == {0}


def test_all_go_on_while_one_link_of_a_ring_is_out() -> None:
    """Rows go the other way round; only those at its ends say that they do not hear each other."""
    scenario = changed("ring6", duration=6.8, load_changes=())
    out = range(200, 300)
    recording = run_with_faults(
        scenario, arrives=lambda block, to, sender: block not in out or {to, sender} != {"r1", "r2"}
    )
    healed = out.stop * scenario.block_duration
    for robot, estimates in recording.estimates.items():
        meanwhile = {each.status for each in estimates if healed - 1.0 < each.time < healed}
        assert meanwhile == ({"stale"} if robot in ("r1", "r2") else {"valid"})
        assert {each.status for each in estimates if each.time > healed + 0.5} == {"valid"}


@pytest.mark.slow
def test_a_load_that_falls_while_halves_cannot_talk_is_known_when_they_can() -> None:
    healed = FROM + 0.8
    load = LoadChange(at=FROM + 0.4, mass=2.0, position=(-0.1, 0.1, 0.07))
    story = Story(healed + SOON, [Partition(group=("r1", "r2"), start=FROM, end=healed)], (load,))
    assert story.statuses(FROM) == {"valid"}
    assert story.statuses(healed + SOON) == {"valid"}
    for name in ROBOTS:
        before, after = story.at(name, FROM).payload, story.at(name, healed + SOON).payload
        assert before is not None
        assert after is not None
        assert after.mass - before.mass == pytest.approx(load.mass, abs=0.1)


@pytest.mark.parametrize(("loss", "seed"), [(0.02, 1), (0.1, 2)])
def test_lost_messages_cost_time_and_never_the_truth(loss: float, seed: int) -> None:
    load = LoadChange(at=5.0, mass=2.0, position=(-0.1, 0.1, 0.07))
    lossless = 6.0
    faults = [Loss(start=0.0, end=lossless, probability=loss, seed=seed)]
    story = Story(lossless + SOON, faults, (load,), seed=seed)
    assert story.statuses(lossless + SOON) == {"valid"}
    if loss < 0.05:
        # Few messages are lost: few blocks are missed.
        for estimates in story.estimates.values():
            seen = [estimate for estimate in estimates if 3.0 < estimate.time < load.at]
            assert sum(estimate.status == "valid" for estimate in seen) > 0.5 * len(seen)
