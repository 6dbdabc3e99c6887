"""Robots driven from ROS 2: what they measure comes as stock messages, and nodes hear what they want and believe."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import count, islice
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from coheft.agents.motion.reference import make_motion
from coheft.app.run.keys import make_keys
from coheft.app.run.plan import Plan, make_plan
from coheft.app.study.samples import TeamSamples, simulate
from coheft.wire.config import AgentConfig
from coheft.wire.scenario.file import load_scenario
from coheft.wire.transport.sessions import Keys
from tests.ports import free_port

from .ros2_network import ACCEL, INERTIA, TWIST, WRENCH, Command, router, started
from .team import AGENT, LIMIT, Team, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")

STORE = get_typestore(Stores.ROS2_KILTED)
TYPES = STORE.types
START = 1_790_000_000_250_000_000
"""Stamp of the first measurement [ns]."""
AHEAD = 20
"""Blocks that the sensors may be ahead of the agents' answers."""
PATIENCE = 5.0
"""For so long they wait for these [s]."""
REPORT_EVERY = 5
"""Blocks from one estimate to the next."""
POSE = "geometry_msgs::msg::dds_::PoseStamped_/RIHS01_10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8"


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
        session: Their session.
    """

    def __init__(self, ros: zenoh.Session, names: list[str]) -> None:
        self.wanted = dict.fromkeys(names, 0)
        self.estimates: dict[str, Any] = {}
        self.session = ros
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
        def receive(sample: zenoh.Sample) -> None:
            self.wanted[name] = stamp_of(decoded(sample, "geometry_msgs/msg/WrenchStamped"))

        return receive

    def _keep(self, name: str) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            self.estimates[name] = decoded(sample, "geometry_msgs/msg/InertiaStamped")

        return receive

    def measure(self, name: str, stream: str, stamp: int, sample: np.ndarray) -> None:
        self._publishers[name, stream].put(cdr(stream, name, stamp, sample))


def decoded(sample: zenoh.Sample, kind: str) -> Any:
    return STORE.deserialize_cdr(sample.payload.to_bytes(), kind)


class Told:
    """What one arm is told, sample by sample: messages by stamp. Some may be lost, more so on a busy machine."""

    def __init__(self, ros: zenoh.Session, name: str) -> None:
        self.poses: dict[int, Any] = {}
        self.twists: dict[int, Any] = {}
        self._kept = [
            ros.declare_subscriber(f"0/{name}/reference/pose/{POSE}", self._gather(self.poses, "PoseStamped")),
            ros.declare_subscriber(f"0/{name}/reference/twist/{TWIST}", self._gather(self.twists, "TwistStamped")),
        ]

    @staticmethod
    def _gather(messages: dict[int, Any], kind: str) -> Callable[[zenoh.Sample], None]:
        def receive(sample: zenoh.Sample) -> None:
            message = decoded(sample, f"geometry_msgs/msg/{kind}")
            messages[stamp_of(message)] = message

        return receive

    def both(self) -> set[int]:
        """Stamps at which the arm knows where to be and how fast to move."""
        return set(self.poses.copy()) & set(self.twists.copy())

    def check(self, config: AgentConfig, epoch: int) -> None:
        """It is what the agent wants, if its first sample is taken at ``epoch`` [ns]."""
        motion = make_motion(config)
        for stamp in self.both():
            number, late = divmod((stamp - epoch) * config.rate, 10**9)
            assert late == 0
            block, row = divmod(number, config.block)
            assert block >= config.lag
            pose, twist = self.poses[stamp], self.twists[stamp]
            assert (pose.header.frame_id, twist.header.frame_id) == (f"{config.name}_home",) * 2
            told: list[np.ndarray | list[float]] = [
                Rotation.from_quat(coordinates(pose.pose.orientation, "xyzw")).as_rotvec(),
                coordinates(pose.pose.position, "xyz"),
                coordinates(twist.twist.angular, "xyz"),
                coordinates(twist.twist.linear, "xyz"),
            ]
            np.testing.assert_allclose(np.concatenate(told), motion.reference(block)[row], atol=1e-12)


def coordinates(part: Any, names: str) -> list[float]:
    return [getattr(part, name) for name in names]


@contextmanager
def driven(plan: Plan, folder: Path) -> Iterator[tuple[Robots, Command, Team]]:
    """Robots that are all driven by one command, which waits for what they measure."""
    paths = plan.write(folder)
    port = free_port()
    with ExitStack() as stack:
        ros = stack.enter_context(router(port))
        robots = Robots(ros, list(plan.agents))
        arguments = ["-m", "coheft", "ros2-driver", *paths[1:], "--endpoint", f"tcp/127.0.0.1:{port}"]
        command = stack.enter_context(started(arguments, folder / "driver.txt"))
        team = Team(plan, Keys(plan.server.run), folder, ros, {})
        for name, config in plan.agents.items():
            team.start(name, AGENT, config)
            stack.callback(team.end, name)
        wait_until(lambda: "waiting for measurements" in command.said(), "the driver")
        yield robots, command, team


def test_agents_that_are_driven_from_ros_find_out_what_they_hold(tmp_path: Path) -> None:
    plan, measured = measured_team(duration=6.0)
    names, sensors = list(plan.agents), plan.server.scenario.sensors
    with driven(plan, tmp_path) as (robots, command, team):
        period = 10**9 // sensors.rate
        for number, sample in enumerate(measured.samples):
            for name, row in zip(names, sample, strict=True):
                for stream in ("wrench", "twist", "acceleration"):
                    # Sensors that sample on their own keep time only roughly.
                    jitter = 10**5 * ((7 * number) % 11 - 5) if number else 0
                    robots.measure(name, stream, START + number * period + jitter, row)
            due = START + (number - AHEAD * sensors.block) * period
            if due > START:
                # On a busy machine links are cut and answers get lost: sensors go on.
                patience = time.monotonic() + PATIENCE
                while min(robots.wanted.values()) < due and time.monotonic() < patience:
                    time.sleep(0.005)
        last = START + (len(measured.samples) - REPORT_EVERY * sensors.block) * period

        def all_have_reported() -> bool:
            return len(robots.estimates) == len(names) and min(map(stamp_of, robots.estimates.values())) >= last

        wait_until(all_have_reported, "the last estimates")
        for name in names:
            inertia = robots.estimates[name].inertia
            assert inertia.m == pytest.approx(measured.truths[-1].payload.mass, rel=0.02)
            assert np.isfinite([inertia.com.x, inertia.com.y, inertia.com.z, inertia.ixx]).all()
        assert f"block 0 begins at {(START + sensors.block * period) / 1e9:.3f} s" in command.said()
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
        team = Team(plan, Keys(plan.server.run), tmp_path, ros, {})
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
        wait_until(lambda: "block 0 begins at" in command.said(), "the driver to go on with r2 alone")
        robots.measure("r2", "wrench", START, measured.samples[0, 1])
        wait_until(lambda: "no complete block for" in command.said(), "its word")
        assert "refused from /r1/wrench: not a geometry_msgs/msg/WrenchStamped" in command.said()
        assert "refused from /r1/twist: twist contains 6 numbers that are not finite" in command.said()
        assert "r2: no complete block for 4 s; since the last one there came 1 of wrench, 0 of twist" in command.said()
        team.end("r3")
        wait_until(lambda: "the agent of r3 is gone; waiting for it" in command.said(), "that it is gone")
        team.start("r3", AGENT, plan.agents["r3"])
        wait_until(lambda: "the agent of r3 is back" in command.said(), "that it is back")
        ros.close()
        wait_until(lambda: "the router of ROS 2 is gone; waiting for it" in command.said(), "that the router is gone")
        assert command.interrupt() == 130
        assert "Traceback" not in command.said()


def test_a_clock_that_is_wrong_for_a_while_does_no_lasting_harm(tmp_path: Path) -> None:
    plan, measured = measured_team(duration=1.0)
    plan = make_plan(plan.server.scenario, "realtime")  # agents do not wait long for one that misses blocks
    names, sensors = list(plan.agents), plan.server.scenario.sensors
    with driven(plan, tmp_path) as (robots, command, _):
        numbers = count()
        period = 10**9 // sensors.rate

        def measure(blocks: int, wrong: str = "") -> int:
            """Measure so many blocks, one robot with a clock that is an hour ahead; the last stamp."""
            for number in islice(numbers, blocks * sensors.block):
                for name, row in zip(names, measured.samples[number % len(measured.samples)], strict=True):
                    for stream in ("wrench", "twist", "acceleration"):
                        late = 3600 * 10**9 if name == wrong else 0
                        robots.measure(name, stream, START + number * period + late, row)
                time.sleep(1.0 / sensors.rate)
            return START + number * period

        measure(3, wrong="r1")  # before anybody else: it does not say when the run begins
        last = measure(10)

        def all_go_on() -> bool:
            measure(1)
            return min(robots.wanted.values()) > last

        wait_until(all_go_on, "all robots' references")
        begins = float(command.said().partition("block 0 begins at ")[2].split()[0])
        assert START / 1e9 < begins < last / 1e9
        last = measure(3, wrong="r2")
        wait_until(all_go_on, "all robots' references after the error")
        assert max(robots.wanted.values()) < last + 600 * 10**9
        assert "refused from /r2/" in command.said()
        assert "s ahead of the time that has passed" in command.said()
        assert command.interrupt() == 130, command.said()


def test_drivers_of_one_team_begin_together_and_say_what_each_arm_shall_do(tmp_path: Path) -> None:
    plan, measured = measured_team(duration=1.5)
    sensors, epoch = plan.server.scenario.sensors, 5 * 10**9
    _, *paths = plan.write(tmp_path)
    port = free_port()
    with ExitStack() as stack:
        ros = stack.enter_context(router(port))
        robots = Robots(ros, list(plan.agents))
        told = {name: Told(ros, name) for name in plan.agents}
        commands = []
        for driven in (paths[:1], paths[1:]):
            arguments = ["-m", "coheft", "ros2-driver", *driven, "--endpoint", f"tcp/127.0.0.1:{port}", "--epoch", "5"]
            commands.append(stack.enter_context(started(arguments, tmp_path / f"{len(driven)}.txt")))
        team = Team(plan, Keys(plan.server.run), tmp_path, ros, {})
        for name, config in plan.agents.items():
            team.start(name, AGENT, config)
            stack.callback(team.end, name)
        for command in commands:
            wait_until(lambda command=command: "block 0 begins at 5.000 s" in command.said(), "the drivers")
        period = 10**9 // sensors.rate
        numbers = count(-sensors.block)  # sensors do not wait for the epoch

        def have_heard_enough() -> bool:
            """After one more block."""
            for number in islice(numbers, sensors.block):
                for name, row in zip(plan.agents, measured.samples[number % len(measured.samples)], strict=True):
                    for stream in ("wrench", "twist", "acceleration"):
                        robots.measure(name, stream, epoch + number * period, row)
            time.sleep(sensors.block / sensors.rate)
            return min(robots.wanted.values()) > 0 and min(len(each.both()) for each in told.values()) > 100

        wait_until(have_heard_enough, "what the arms shall do")
        for name, config in plan.agents.items():
            told[name].check(config.agent, epoch)
            assert (robots.wanted[name] - epoch) % (sensors.block * period) == 0
        for command in commands:
            assert command.interrupt() == 130, command.said()


def test_an_epoch_of_another_clock_is_refused(tmp_path: Path) -> None:
    plan, measured = measured_team(duration=0.1)
    paths = plan.write(tmp_path)
    port = free_port()
    with ExitStack() as stack:
        robots = Robots(stack.enter_context(router(port)), list(plan.agents))
        arguments = ["-m", "coheft", "ros2-driver", *paths[1:], "--endpoint", f"tcp/127.0.0.1:{port}", "--epoch", "5"]
        command = stack.enter_context(started(arguments, tmp_path / "driver.txt"))
        team = Team(plan, Keys(plan.server.run), tmp_path, robots.session, {})
        for name, config in plan.agents.items():
            team.start(name, AGENT, config)
            stack.callback(team.end, name)
        wait_until(lambda: "waiting for measurements" in command.said(), "the driver")

        def has_ended() -> bool:
            for name in plan.agents:
                robots.measure(name, "wrench", START, measured.samples[0, 0])
            return command.process.poll() is not None

        wait_until(has_ended, "its end")
        assert command.process.returncode == 1
        assert "--epoch 5.000 is 1.79e+09 s before the robots' stamps" in command.said()
        for name in plan.agents:
            assert team.exit_status(name) == 0, team.log(name)


def test_the_driver_refuses_what_is_no_agent(tmp_path: Path) -> None:
    plan, _ = measured_team(duration=0.1)
    server, *agents = plan.write(tmp_path)
    other = make_plan(plan.server.scenario).write(tmp_path / "other")[-1]
    for arguments, status, words in (
        ([], 2, "expected the configuration of an agent"),
        ([server], 1, "server.json: expected the configuration of an agent"),
        ([tmp_path / "none.json"], 1, "none.json: cannot be read"),
        ([agents[0], other], 1, f"{agents[0]}, {other} are of different runs: name agents of one"),
        ([agents[0], "--domain", "-1"], 2, "domain"),
        ([agents[0]], 2, "no --epoch, and r2, r3 not driven here"),
    ):
        with started(["-m", "coheft", "ros2-driver", *arguments], tmp_path / "said.txt") as command:
            assert command.process.wait(LIMIT) == status
            assert words in command.said()
            assert "Traceback" not in command.said()
