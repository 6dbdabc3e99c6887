"""When blocks are simulated, and which answers come too late for theirs."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from coheft.app.run.plan import make_plan
from coheft.physics_server.clock import Clock, Stopwatch
from coheft.physics_server.robots import Robots
from coheft.wire.messages.structs import Measurements, Reference
from coheft.wire.process.log import log_to_stderr
from coheft.wire.process.problem_log import ProblemLog
from coheft.wire.scenario.file import load_scenario
from coheft.wire.transport.inbox import Inbox
from coheft.wire.transport.robot_link import RobotLink
from coheft.wire.transport.sessions import Keys, Sender, open_session
from tests.ports import free_port
from tests.wall_clock import WallClock, wall_clock_of

DURATION = 0.02
LAG = 2
SAMPLES = 5


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> WallClock:
    return wall_clock_of("coheft.physics_server.clock", monkeypatch)


def test_in_real_time_a_block_is_simulated_when_it_has_ended(now: WallClock) -> None:
    clock = Clock("realtime", LAG, DURATION)
    clock.start(0)
    for block in range(3):
        assert clock.delay(block, answered=-1) == pytest.approx((block + 1) * DURATION)
    now.time += 1.5 * DURATION
    assert clock.delay(0, answered=-1) == 0.0
    assert clock.delay(1, answered=-1) == pytest.approx(0.5 * DURATION)


def test_a_paced_clock_waits_for_robots_and_is_no_faster_than_the_wall(now: WallClock) -> None:
    clock = Clock("paced", LAG, DURATION)
    clock.start(0)
    assert clock.delay(LAG + 1, answered=0) == math.inf
    assert clock.delay(LAG + 1, answered=1) == pytest.approx((LAG + 2) * DURATION)


def test_a_paced_clock_goes_slower_where_robots_are_slow_and_makes_up_for_small_delays_only(now: WallClock) -> None:
    clock = Clock("paced", LAG, DURATION)
    clock.start(0)
    now.time += 3 * DURATION
    assert [clock.delay(block, answered=block) for block in range(4)] == pytest.approx([0.0, 0.0, 0.0, DURATION])
    now.time += 100.0
    assert clock.delay(4, answered=4) == pytest.approx(0.0, abs=1e-9)
    assert clock.delay(5, answered=5) == pytest.approx(DURATION), "a hundred seconds are not made up for"


def test_in_real_time_nothing_is_made_up_for_after_a_pause(now: WallClock) -> None:
    clock = Clock("realtime", LAG, DURATION)
    clock.start(0)
    now.time += 1000.0
    clock.start(50)
    assert clock.delay(50, answered=-1) == pytest.approx(DURATION)


def test_in_lockstep_a_block_waits_for_the_answers_that_it_needs() -> None:
    clock = Clock("lockstep", LAG, DURATION)
    clock.start(0)
    assert [clock.delay(block, answered=7) for block in (8, 9, 10)] == [0.0, 0.0, math.inf]


def test_where_many_blocks_may_be_under_way_they_come_by_twos() -> None:
    clock = Clock("lockstep", 4, DURATION)
    clock.start(0)
    assert [clock.delay(block, answered=4) for block in (7, 8, 9)] == [0.0, math.inf, math.inf]
    assert [clock.delay(block, answered=5) for block in (8, 9, 10)] == [0.0, 0.0, math.inf]
    for block in range(20):  # nothing stands still: it is enough that all that there is has been answered
        assert clock.delay(block, answered=block - 1) == 0.0


def test_a_stopwatch_adds_up_the_time_for_which_it_runs(now: WallClock) -> None:
    watch = Stopwatch()
    for _ in range(2):
        watch.start()
        now.time += 3.0
        watch.start()  # it runs already
        watch.stop()
        now.time += 10.0
    assert watch.elapsed == pytest.approx(6.0)


@pytest.mark.parametrize("lookahead", [1, 4])
def test_in_real_time_no_robot_waits_for_longer_than_its_own_answer_can_take(lookahead: int) -> None:
    scenario = msgspec.structs.replace(load_scenario("ring3"), lookahead=lookahead)
    for robot in make_plan(scenario, "realtime").agents.values():
        assert robot.patience == pytest.approx(lookahead * scenario.block_duration)
    for robot in make_plan(scenario, "lockstep").agents.values():
        assert robot.patience > 1.0


@pytest.mark.usefixtures("process_log")
def test_answers_that_are_not_there_when_their_block_begins_are_late(capfd: pytest.CaptureFixture[str]) -> None:
    log_to_stderr()
    log = ProblemLog("server", Sender(None, "clock/observe/server/problem", may_drop=True))
    names = ("r1", "r2")
    with open_session(listen=[f"tcp/127.0.0.1:{free_port()}"]) as session:
        links = [RobotLink(name, session, Inbox(), Keys("clock"), world=1, lag=LAG, block=SAMPLES) for name in names]
        robots = Robots(links, log, return_limit=10.0)
        for link in links:
            link.is_ready = True
        for block in range(10):
            there = list(robots.take_references(block, block * DURATION))
            assert there == ([] if block < LAG else ["r1"] if block == 7 else ["r1", "r2"])  # no one can be sooner
            sent = {name: Measurements(robot=name, block=block, samples=np.zeros((SAMPLES, 15))) for name in names}
            robots.send_measurements(sent, block, "")
            for name in names:
                if (name, block + LAG) != ("r2", 7):
                    robots.take(name, _answer(name, block))
    assert robots.late_references == 1
    assert capfd.readouterr().err == "r2 answered too late at 0.14 s; further late answers are counted\n"


def _answer(name: str, block: int) -> Reference:
    motion, wrench = np.zeros((SAMPLES, 12)), np.zeros(6)
    return Reference(robot=name, block=block + LAG, answers=block, motion=motion, wrench=wrench)
