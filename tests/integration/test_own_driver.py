"""Drivers of one's own: agents that the example feeds with a recording believe what they did in the recorded run."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.app.run.inprocess import run_in_process
from coheft.app.run.plan import Plan, make_plan
from coheft.errors import LinkError
from coheft.wire.config import AgentProcessConfig
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import Estimate, Measurements, Ready, Reference
from coheft.wire.process.log import log_to_stderr
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.driver import Driver, open_driver
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.sessions import Keys, Sender, open_session

from .team import wait_until

ROOT = Path(__file__).parents[2]
DRIVER = ROOT / "examples" / "own_driver.py"
LIMIT = 90.0
DURATION = 4.0


def recorded(folder: Path, duration: float) -> Path:
    """A recording of a run by the real processes."""
    data = folder / "run.npz"
    command = [sys.executable, "-m", "coheft", "run", "ring3", "--duration", str(duration), "--save-data", str(data)]
    done = subprocess.run(
        [*command, "--quiet", "--logs", str(folder / "logs")],
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode in (0, 3), done.stderr
    return data


def last_estimates(scenario: Scenario) -> dict[str, Estimate]:
    """What every robot believes at the end of a run."""
    last: dict[str, Estimate] = {}
    for block in run_in_process(scenario):
        last |= block.estimates
    return last


def driven(plan: Plan, data: Path, folder: Path, block: int) -> dict[str, Estimate]:
    """What the agents believe after a block, fed by the example."""
    files = [str(path) for path in plan.write(folder / "team") if path.stem != "server"]
    inbox, keys = Inbox(), Keys(plan.server.run)
    processes = []
    with open_session(connect=[agent.observe for agent in plan.agents.values()]) as session:
        for name in plan.agents:
            inbox.listen(session, name, {keys.observe_agent(name, "estimate"): Estimate})
        try:
            for file in files:
                processes.append(subprocess.Popen([sys.executable, "-m", "coheft", "agent", file], cwd=ROOT))
            driver = subprocess.Popen(
                [sys.executable, str(DRIVER), str(data), *files], cwd=ROOT, stdout=subprocess.PIPE, text=True
            )
            processes.append(driver)
            believed: dict[str, Estimate] = {}
            deadline = time.monotonic() + LIMIT
            while len(believed) < len(files):
                assert time.monotonic() < deadline, f"only {sorted(believed)} said something about block {block}"
                event = inbox.receive(1.0)
                if isinstance(event, Received) and isinstance(told := event.message, Estimate) and told.block == block:
                    believed[event.source] = told
            shown = driver.communicate(timeout=LIMIT)[0]
            assert [process.wait(LIMIT) for process in processes] == [0] * len(processes)
            for name, told in believed.items():
                assert told.payload is not None
                assert f"{name} at {told.time:.1f} s: {told.status}, mass {told.payload.mass:.3f} kg" in shown
            return believed
        finally:
            for process in processes:
                process.kill()
                process.wait()


def test_agents_believe_the_same_as_in_the_run_that_was_recorded(tmp_path: Path) -> None:
    scenario = msgspec.structs.replace(load_scenario("ring3"), duration=DURATION, load_changes=())
    data = recorded(tmp_path, DURATION)
    expected = last_estimates(scenario)
    block = expected["r1"].block
    found = driven(make_plan(scenario), data, tmp_path, block)
    assert sorted(found) == ["r1", "r2", "r3"]
    for name, estimate in found.items():
        assert encode(estimate, "key") == encode(expected[name], "key")


def test_a_recording_of_other_robots_is_refused(tmp_path: Path) -> None:
    scenario = msgspec.structs.replace(load_scenario("ring3"), duration=0.2)
    data = recorded(tmp_path, 0.2)
    sensors = msgspec.structs.replace(scenario.sensors, rate=1000)
    plan = make_plan(msgspec.structs.replace(scenario, sensors=sensors))
    files = [str(path) for path in plan.write(tmp_path / "team") if path.stem != "server"]
    done = subprocess.run(
        [sys.executable, str(DRIVER), str(data), *files], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "found r1, r2, r3 at 500 samples a second, but the agents expect r1, r2, r3 at 1000" in done.stderr


@contextmanager
def fed_driver(name: str) -> Iterator[tuple[Driver, AgentProcessConfig, Inbox, Sender]]:
    """A driver, the agent's configuration, what the agent is sent, and a sender of its references."""
    config = make_plan(load_scenario("ring3")).agents[name]
    keys, inbox = Keys(config.run), Inbox()
    with open_driver(config) as driver, open_session(connect=[config.server]) as agent:
        inbox.listen(agent, "the driver", {keys.robot(name, "measurements"): Measurements})
        ready, reference = (Sender(agent, keys.robot(name, topic), may_drop=False) for topic in ("ready", "reference"))

        def is_fed() -> bool:
            ready.send(Ready(robot=name))
            with suppress(LinkError):
                driver.wait_for_agent(0.1)
                return True
            return False

        wait_until(is_fed, "the driver to hear its agent")
        yield driver, config, inbox, reference


@pytest.mark.parametrize(("part", "bad"), [("motion", np.nan), ("motion", np.inf), ("wrench", -np.inf)])
@pytest.mark.usefixtures("process_log")
def test_references_that_are_not_finite_are_told_once_with_their_robot_and_not_handed_to_its_arm(
    capfd: pytest.CaptureFixture[str], part: str, bad: float
) -> None:
    log_to_stderr()
    with fed_driver("r2") as (driver, config, _, reference):
        size, lag = config.agent.block, config.agent.lag
        for block, number in enumerate((bad, bad, 0.0)):
            driver.send(block, np.zeros((size, 15)))
            numbers = {"motion": np.zeros((size, 12)), "wrench": np.zeros(6)}
            numbers[part][-1:] = number
            reference.send(Reference(robot="r2", block=block + lag, answers=block, **numbers))
        wanted = [driver.reference(block + lag) for block in range(3)]
    assert [each is None for each in wanted] == [True, True, False]
    assert capfd.readouterr().err == (
        f"refused from r2: the reference of block {lag} is not finite: its arm holds still until it gets a reference "
        "that it can follow\n"
    )


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_agents_compute_in_double_precision_whatever_sensors_give(kind: type[np.generic]) -> None:
    with fed_driver("r2") as (driver, config, inbox, _):
        driver.send(0, np.ones((config.agent.block, 15), dtype=kind))
        received = inbox.receive(LIMIT)
    assert isinstance(received, Received)
    assert isinstance(received.message, Measurements)
    assert received.message.samples.dtype == np.float64
