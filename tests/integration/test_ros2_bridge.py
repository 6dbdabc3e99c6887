"""Runs seen from ROS 2: nodes that others have made hear what the robots believe."""

from __future__ import annotations

import json
import os
import shutil
import struct
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coheft.app.run.folder import announce
from coheft.app.run.keys import make_keys
from coheft.app.run.plan import make_plan
from coheft.wire.messages.requests import StopRequest
from coheft.wire.transport.sessions import open_session
from tests.ports import free_port

from .ros2_network import INERTIA, Command, router, started, tokens
from .team import Team, running_team, small_scenario, wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")
MASS = 8.0
TYPES = {
    "/clock": "rosgraph_msgs/msg/Clock",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
    "/payload/inertia": "geometry_msgs/msg/InertiaStamped",
    "/payload/pose": "geometry_msgs/msg/PoseStamped",
    "/r3/payload": "geometry_msgs/msg/InertiaStamped",
    "/r3/poses/r1": "geometry_msgs/msg/PoseWithCovarianceStamped",
    "/r3/total_wrench": "geometry_msgs/msg/WrenchStamped",
    "/r3/wrench": "geometry_msgs/msg/WrenchStamped",
    "/r3/twist": "geometry_msgs/msg/TwistStamped",
    "/r3/acceleration": "geometry_msgs/msg/AccelStamped",
    "/rosout": "rcl_interfaces/msg/Log",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
}
LATCHED = ":1:,1:,:,:,,"


def bridge(folder: Path, port: int) -> list[str | Path]:
    return ["-m", "coheft", "ros2-bridge", folder, "--endpoint", f"tcp/127.0.0.1:{port}"]


def announced(team: Team, folder: Path) -> None:
    """Let other commands find the team."""
    announce(folder, team.plan.run_file())


def heard(node: Command) -> tuple[dict[str, dict[str, Any]], dict[str, list[str]]]:
    """The last message of each topic that a node has heard, and the topics that it sees."""
    messages: dict[str, dict[str, Any]] = {}
    topics: dict[str, list[str]] = {}
    for line in node.lines():
        said = json.loads(line)
        if "topic" in said:
            messages[said["topic"]] = said["message"]
        else:
            topics = said["topics"]
    return messages, topics


@pytest.mark.skipif(find_spec("zenoh_ros2_sdk") is None, reason="needs the package zenoh-ros2-sdk")
@pytest.mark.skipif(shutil.which("git") is None, reason="zenoh-ros2-sdk needs git")
def test_a_node_that_others_have_made_hears_the_run(tmp_path: Path) -> None:
    port = free_port()
    asked = [f"{topic}={kind}" for topic, kind in TYPES.items() if topic != "/tf_static"]
    asked.append(f"/tf_static={TYPES['/tf_static']}={LATCHED}")
    with router(port), running_team(small_scenario(3), tmp_path) as team:
        team.wait_for_block(0)
        announced(team, tmp_path)
        with started(bridge(tmp_path, port), tmp_path / "bridge.txt") as command:
            wait_until(lambda: "node /coheft" in command.said(), "the bridge")
            time.sleep(0.5)  # what was published once, before the node came, must reach it all the same
            node_arguments = ["-m", "tests.integration.ros2_node", str(port), *asked]
            with started(node_arguments, tmp_path / "node.txt", HOME=str(tmp_path)) as node:

                def has_all() -> bool:
                    assert node.process.poll() is None, node.said()
                    messages, topics = heard(node)
                    return set(TYPES) - {"/rosout"} <= messages.keys() and set(TYPES) <= topics.keys()

                wait_until(has_all, "all topics")
                messages, topics = heard(node)
            team.ask(StopRequest())
            assert command.process.wait(60.0) == 0
            assert "the run has ended" in command.said()
    assert {topic: topics[topic] for topic in TYPES} == {topic: [kind] for topic, kind in TYPES.items()}
    assert messages["/payload/inertia"]["inertia"]["m"] == pytest.approx(MASS)
    assert messages["/r3/payload"]["inertia"]["m"] == pytest.approx(MASS, rel=0.05)
    assert messages["/r3/payload"]["header"]["frame_id"] == "r3"
    pose = messages["/r3/poses/r1"]["pose"]
    assert np.linalg.norm(list(pose["pose"]["orientation"].values())[:4]) == pytest.approx(1.0)
    assert (np.diagonal(np.reshape(pose["covariance"], (6, 6))) > 0.0).all()
    robots = [transform["child_frame_id"] for transform in messages["/tf_static"]["transforms"]]
    assert robots == ["r1", "r2", "r3"]
    assert messages["/tf"]["transforms"][0]["child_frame_id"] == "payload"


def test_tokens_and_attachments_are_those_of_rmw_zenoh_and_go_with_the_bridge(tmp_path: Path) -> None:
    port = free_port()
    attachments: list[bytes] = []
    with router(port) as ros, running_team(small_scenario(3), tmp_path) as team:
        team.wait_for_block(0)
        announced(team, tmp_path)

        def receive(sample: Any) -> None:
            attachments.append(sample.attachment.to_bytes())

        subscriber = ros.declare_subscriber(f"0/r2/payload/{INERTIA}", receive)
        with started(bridge(tmp_path, port), tmp_path / "bridge.txt") as command:
            wait_until(lambda: len(attachments) >= 3, "three estimates")
            seen = tokens(ros)
            assert command.interrupt() == 130
            assert command.said().splitlines()[-1] == "stopped"
        wait_until(lambda: not tokens(ros), "the node to go")
        subscriber.undeclare()
        assert team.status() is not None  # the run goes on
    (node,) = (token for token in seen if "/NN/" in token)
    prefix = node.removesuffix("/0/0/NN/%/%/coheft")
    assert prefix.startswith("@ros2_lv/0/")
    assert prefix.count("/") == 2
    (publisher,) = (token for token in seen if "%r2%payload" in token)
    number = publisher.split("/")[4]
    assert publisher == f"{prefix}/0/{number}/MP/%/%/coheft/%r2%payload/{INERTIA}/::,10:,:,:,,"
    assert len({token.split("/")[4] for token in seen}) == len(seen)
    parts = [struct.unpack("<qqB16s", attachment) for attachment in attachments[:3]]
    assert [sequence for sequence, _, _, _ in parts] == [1, 2, 3]
    assert {(size, gid) for _, _, size, gid in parts} == {(16, parts[0][3])}
    assert abs(parts[0][1] - time.time_ns()) < 3600e9


def test_a_router_that_was_gone_is_found_again(tmp_path: Path) -> None:
    port = free_port()
    with running_team(small_scenario(3), tmp_path) as team:
        team.wait_for_block(0)
        announced(team, tmp_path)
        with router(port):
            command_context = started(bridge(tmp_path, port), tmp_path / "bridge.txt")
            command = command_context.__enter__()
            wait_until(lambda: "node /coheft" in command.said(), "the bridge")
        try:
            wait_until(lambda: "is gone; waiting for it" in command.said(), "the bridge to notice")
            count = 0

            def receive(sample: Any) -> None:
                nonlocal count
                count += 1

            with router(port) as ros:
                subscriber = ros.declare_subscriber(f"0/r1/payload/{INERTIA}", receive)
                wait_until(lambda: count > 0, "an estimate by the new router")
                wait_until(lambda: "the router is back" in command.said(), "the bridge to notice")
                wait_until(lambda: any("/NN/" in token for token in tokens(ros)), "the node")
                subscriber.undeclare()
        finally:
            command_context.__exit__(None, None, None)


def test_a_secure_run_is_seen_by_those_who_have_the_keys_of_an_observer(tmp_path: Path) -> None:
    port, keys, scenario = free_port(), tmp_path / "keys", small_scenario(2, "line")
    make_keys(keys, scenario)
    with router(port) as ros, running_team(scenario, tmp_path, keys_folder=keys) as team:
        team.wait_for_block(0)
        announced(team, tmp_path)
        heard_from: set[str] = set()
        subscriber = ros.declare_subscriber("0/**", lambda sample: heard_from.add(str(sample.key_expr).split("/")[1]))
        with started(bridge(tmp_path, port), tmp_path / "bridge.txt"):
            wait_until(lambda: {"r1", "r2", "payload"} <= heard_from, "all of the team")
        (keys / "observer.key").unlink()
        with started(bridge(tmp_path, port), tmp_path / "again.txt") as command:
            assert command.process.wait(60.0) == 1
            assert "needed by observer" in command.said()
        subscriber.undeclare()


def test_without_a_router_it_says_how_to_start_one(tmp_path: Path) -> None:
    plan = make_plan(small_scenario(2, "line"))
    announce(tmp_path, plan.run_file())
    with (
        open_session(listen=[plan.server.observe]),
        started(bridge(tmp_path, free_port()), tmp_path / "said") as command,
    ):
        assert command.process.wait(60.0) == 1
        assert "rmw_zenohd" in command.said()
        assert "Traceback" not in command.said()
