"""Robots driven from ROS 2: what they measure comes as stock messages, and nodes hear what they want and believe."""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore

from coheft.app.keys import make_keys
from coheft.app.plan import Plan, make_plan
from coheft.app.study.samples import TeamSamples, simulate
from coheft.wire.scenario_file import load_scenario
from coheft.wire.transport import Keys

from .ros2_network import ACCEL, INERTIA, TWIST, WRENCH, free_port, router, started
from .team import AGENT, LIMIT, Team, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")

STORE = get_typestore(Stores.ROS2_KILTED)
TYPES = STORE.types
START = 1_790_000_000_250_000_000
"""Stamp of the first measurement [ns]."""
AHEAD = 20
"""Blocks that the sensors may be ahead of the agents' answers."""
REPORT_EVERY = 5
"""Blocks from one estimate to the next."""


def measured_team(duration: float, keys: Path | None = None) -> tuple[Plan, TeamSamples]:
    """Three robots, and all that they measure; secure if there is a folder for keys."""
    scenario = load_scenario("ring3")
    sensors = msgspec.structs.replace(scenario.sensors, rate=200, block=10)
    scenario = msgspec.structs.replace(scenario, sensors=sensors, load_changes=(), duration=duration)
    if keys is not None:
        make_keys(keys, scenario)
    return make_plan(scenario, keys=keys), simulate(scenario)


def cdr(stream: str, robot: str, stamp: int, sample: np.ndarray) -> bytes:
    """A stock message of one robot's sensors."""
    vectors = [TYPES["geometry_msgs/msg/Vector3"](*part) for part in sample.reshape(5, 3).tolist()]
    gyro, velocity, acceleration, force, torque = vectors
    nothing = TYPES["geometry_msgs/msg/Vector3"](np.nan, np.nan, np.nan)
    header = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](*divmod(stamp, 10**9)), robot)
    content = {
        "wrench": ("Wrench", {"force": force, "torque": torque}),
        "twist": ("Twist", {"angular": gyro, "linear": velocity}),
        "acceleration": ("Accel", {"angular": nothing, "linear": acceleration}),
    }
    kind, parts = content[stream]
    message = TYPES[f"geometry_msgs/msg/{kind}Stamped"](header, TYPES[f"geometry_msgs/msg/{kind}"](**parts))
    return bytes(STORE.serialize_cdr(message, message.__msgtype__))


def stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


class Robots:
    """What publishes the robots' measurements, and what it hears.

    Attributes:
        wanted: Stamp of the latest reference by robot; the first ones may be lost.
        estimates: The latest estimate by robot.
    """

    def __init__(self, ros: zenoh.Session, names: list[str]) -> None:
        self.wanted = dict.fromkeys(names, 0)
        self.estimates: dict[str, Any] = {}
        self._publishers = {
            (name, stream): ros.declare_publisher(f"0/{name}/{stream}/{kind}")
            for name in names
            for stream, kind in (("wrench", WRENCH), ("twist", TWIST), ("acceleration", ACCEL))
        }
        self._kept = [
            subscriber
            for name in names
            for subscriber in (
                ros.declare_subscriber(f"0/{name}/reference/wrench/{WRENCH}", self._note(name)),
                ros.declare_subscriber(f"0/{name}/payload/{INERTIA}", self._keep(name)),
            )
        ]

    def _note(self, name: str) -> Callable[[zenoh.Sample], None]:
        def hear(sample: zenoh.Sample) -> None:
            self.wanted[name] = stamp_of(decoded(sample, "geometry_msgs/msg/WrenchStamped"))

        return hear

    def _keep(self, name: str) -> Callable[[zenoh.Sample], None]:
        def hear(sample: zenoh.Sample) -> None:
            self.estimates[name] = decoded(sample, "geometry_msgs/msg/InertiaStamped")

        return hear

    def measure(self, name: str, stream: str, stamp: int, sample: np.ndarray) -> None:
        self._publishers[name, stream].put(cdr(stream, name, stamp, sample))


def decoded(sample: zenoh.Sample, kind: str) -> Any:
    return STORE.deserialize_cdr(sample.payload.to_bytes(), kind)


def test_agents_that_are_driven_from_ros_find_out_what_they_hold(tmp_path: Path) -> None:
    plan, measured = measured_team(duration=6.0)
    names, sensors = list(plan.agents), plan.server.scenario.sensors
    paths = plan.write(tmp_path)
    port = free_port()
    with ExitStack() as stack:
        ros = stack.enter_context(router(port))
        robots = Robots(ros, names)
        arguments = ["-m", "coheft", "ros2-driver", *paths[1:], "--endpoint", f"tcp/127.0.0.1:{port}"]
        command = stack.enter_context(started(arguments, tmp_path / "driver.txt"))
        team = Team(plan, Keys(plan.run), tmp_path, ros, {})
        for name, config in plan.agents.items():
            team.start(name, AGENT, config)
            stack.callback(team.end, name)
        wait_until(lambda: "waiting for measurements" in command.said(), "the driver")
        period = 10**9 // sensors.rate
        for number, sample in enumerate(measured.samples):
            for name, row in zip(names, sample, strict=True):
                for stream in ("wrench", "twist", "acceleration"):
                    # Sensors that sample on their own keep time only roughly.
                    jitter = 10**5 * ((7 * number) % 11 - 5) if number else 0
                    robots.measure(name, stream, START + number * period + jitter, row)
            due = START + (number - AHEAD * sensors.block) * period
            if due > START:
                wait_until(lambda due=due: min(robots.wanted.values()) >= due, f"an answer to what came at {due}")
        last = START + (len(measured.samples) - REPORT_EVERY * sensors.block) * period

        def all_have_reported() -> bool:
            return len(robots.estimates) == len(names) and min(map(stamp_of, robots.estimates.values())) >= last

        wait_until(all_have_reported, "the last estimates")
        for name in names:
            inertia = robots.estimates[name].inertia
            assert inertia.m == pytest.approx(measured.truths[-1].payload.mass, rel=0.02)
            assert np.isfinite([inertia.com.x, inertia.com.y, inertia.com.z, inertia.ixx]).all()
        assert f"block 0 begins at {START / 1e9:.3f} s" in command.said()
        assert command.interrupt() == 130
        for name in names:
            assert team.exit_status(name) == 0, team.log(name)


def test_the_driver_of_a_secure_team_says_what_it_waits_for_and_what_makes_no_sense(tmp_path: Path) -> None:
    plan, measured = measured_team(0.1, tmp_path / "keys")
    paths = plan.write(tmp_path)
    port = free_port()
    with ExitStack() as stack:
        ros = stack.enter_context(router(port))
        robots = Robots(ros, list(plan.agents))
        arguments = ["-m", "coheft", "ros2-driver", *paths[1:], "--endpoint", f"tcp/127.0.0.1:{port}"]
        command = stack.enter_context(started(arguments, tmp_path / "driver.txt"))
        team = Team(plan, Keys(plan.run), tmp_path, ros, {})
        for name in ("r1", "r2"):
            team.start(name, AGENT, plan.agents[name])
            stack.callback(team.end, name)
        wait_until(lambda: "waiting for the agents of r1, r2, r3" in command.said(), "its word")
        team.start("r3", AGENT, plan.agents["r3"])
        stack.callback(team.end, "r3")
        wait_until(lambda: "waiting for measurements" in command.said(), "the driver")
        bad = np.full(15, np.nan)
        ros.put(f"0/r1/wrench/{WRENCH}", b"\x00\x01\x00\x00rubbish")
        robots.measure("r1", "twist", START, bad)
        robots.measure("r2", "wrench", START, measured.samples[0, 1])
        wait_until(lambda: "no complete block for" in command.said(), "its word")
        assert "refused from /r1/wrench: not a geometry_msgs/msg/WrenchStamped" in command.said()
        assert "refused from /r1/twist: twist holds 6 numbers that are not finite" in command.said()
        assert "r2: no complete block for 5 s; since the last one there came 1 of wrench, 0 of twist" in command.said()
        assert command.interrupt() == 130
        assert "Traceback" not in command.said()


def test_the_driver_refuses_what_is_no_agent(tmp_path: Path) -> None:
    plan, _ = measured_team(duration=0.1)
    server, *agents = plan.write(tmp_path)
    for arguments, words in (
        ([], "expected the configuration of an agent"),
        ([server], "server.json: expected the configuration of an agent"),
        ([tmp_path / "none.json"], "none.json: cannot be read"),
        ([agents[0], "--domain", "-1"], "domain"),
    ):
        with started(["-m", "coheft", "ros2-driver", *arguments], tmp_path / "said.txt") as command:
            assert command.process.wait(LIMIT) in (1, 2)
            assert words in command.said()
            assert "Traceback" not in command.said()
