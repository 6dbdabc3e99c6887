"""Names, keys and tokens of ROS 2 on Zenoh: ours, and those of other nodes."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from coheft.app.recording import ros
from coheft.app.ros2.graph import Seen, reasons, seen_in, shared
from coheft.app.ros2.names import Node, Topic, attachment, check_ros_names, namespace_of
from coheft.app.ros2.node import open_node, typed_topic
from coheft.errors import CoheftError, LinkError
from tests.integration.ros2_network import router
from tests.ports import free_port

LOG = Topic(
    "/rosout",
    "rcl_interfaces/msg/Log",
    "RIHS01_e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac",
)


def test_keys_and_tokens_are_those_that_a_node_on_rmw_zenoh_shows() -> None:
    typed = f"rcl_interfaces::msg::dds_::Log_/{LOG.type_hash}"
    assert LOG.key(7) == f"7/rosout/{typed}"
    node = Node(7, "943f9ebc32acd3e072bfda12ce8c7ed2", "talker")
    start = "@ros2_lv/7/943f9ebc32acd3e072bfda12ce8c7ed2/0"
    assert node.token() == f"{start}/0/NN/%/%/talker"
    assert node.endpoint_token(1, "MP", LOG) == f"{start}/1/MP/%/%/talker/%rosout/{typed}/::,10:,:,:,,"
    nested = Topic("/r3/poses/r1", LOG.kind, LOG.type_hash, latched=True)
    assert nested.key(0) == f"0/r3/poses/r1/{typed}"
    assert node.endpoint_token(2, "MS", nested) == f"{start}/2/MS/%/%/talker/%r3%poses%r1/{typed}/:1:,1:,:,:,,"


def test_the_types_hash_is_that_of_ros() -> None:
    assert ros.type_hash(LOG.kind) == LOG.type_hash


def test_an_attachment_is_three_numbers_and_sixteen_bytes() -> None:
    data = attachment(3, 5, bytes(range(16)))
    assert len(data) == 33
    assert struct.unpack("<qqB16s", data) == (3, 5, 16, bytes(range(16)))


@pytest.mark.parametrize("name", ["r1", "left_arm", "R2D2"])
def test_names_that_ros_takes(name: str) -> None:
    check_ros_names([name])


@pytest.mark.parametrize("name", ["1r", "left-arm", "a__b", "a_", "", "a/b", "ä"])
def test_names_that_ros_does_not_take(name: str) -> None:
    with pytest.raises(CoheftError, match="cannot be in the name of a ROS topic"):
        check_ros_names(["r1", name])


WRENCH = typed_topic("/r1/wrench", "geometry_msgs/msg/WrenchStamped")


def publisher(topic: Topic, domain: int = 0, node: str = "arm") -> str:
    return Node(domain, "943f9ebc", node).endpoint_token(3, "MP", topic)


def test_tokens_of_others_are_read() -> None:
    node = Node(7, "943f9ebc", "talker", "/cell/left")
    assert seen_in([node.token(), node.endpoint_token(1, "MP", WRENCH), node.endpoint_token(2, "MS", WRENCH)]) == [
        Seen(7, "943f9ebc", "/cell/left/talker"),
        Seen(7, "943f9ebc", "/cell/left/talker", "/r1/wrench", WRENCH.kind, WRENCH.type_hash),
    ]
    assert seen_in([Node(0, "1", "talker").token()]) == [Seen(0, "1", "/talker")]
    assert seen_in(["", "@ros2_lv/0", "@ros2_lv/x/1/0/0/NN/%/%/talker", "a/b/c/d/e/f/g/h/i/j/k/l/m"]) == []


@pytest.mark.parametrize(
    ("published", "reason"),
    [
        (
            [],
            "/r1/wrench: no node publishes anything by this router: do nodes run, with RMW_IMPLEMENTATION=",
        ),
        (
            [publisher(LOG)],
            "/r1/wrench: not published, nor anything else of type geometry_msgs/WrenchStamped, in ROS domain 0",
        ),
        ([publisher(WRENCH)], "/r1/wrench: node /arm has a publisher, but nothing comes from it"),
        (
            [publisher(typed_topic("/r1/wrench", "geometry_msgs/msg/Wrench"))],
            "node /arm publishes geometry_msgs/Wrench, which has no stamp; expected geometry_msgs/WrenchStamped",
        ),
        (
            [publisher(typed_topic("/r1/wrench", "geometry_msgs/msg/TwistStamped"))],
            "node /arm publishes geometry_msgs/TwistStamped; expected geometry_msgs/WrenchStamped",
        ),
        (
            [publisher(Topic("/r1/wrench", WRENCH.kind, "TypeHashNotSupported"))],
            f"with the type hash TypeHashNotSupported (as in Humble); expected {WRENCH.type_hash}",
        ),
        ([publisher(WRENCH, 7)], "node /arm publishes in ROS domain 7, expected 0: choose it with --domain"),
        (
            [publisher(typed_topic("/cell/r1/wrench", WRENCH.kind))],
            "/r1/wrench: not published, but /cell/r1/wrench is: remap it, or choose --namespace /cell",
        ),
        (
            [publisher(typed_topic("/ft", WRENCH.kind)), publisher(typed_topic("/pose", "geometry_msgs/msg/Pose"))],
            "/r1/wrench: not published; of type geometry_msgs/WrenchStamped there is /ft",
        ),
        (
            [publisher(typed_topic("/ft", WRENCH.kind), 3)],
            "/r1/wrench: not published: there is nothing in ROS domain 0, but in 3",
        ),
    ],
)
def test_what_is_published_instead_is_told(published: list[str], reason: str) -> None:
    (line,) = reasons([WRENCH], seen_in(published), domain=0)
    assert reason in line


def test_topics_of_other_robots_are_in_no_ones_place() -> None:
    seen = seen_in([publisher(typed_topic("/r2/wrench", WRENCH.kind))])
    (line,) = reasons([WRENCH], seen, 0, {"/r1/wrench", "/r2/wrench"})
    assert "not published, nor anything else" in line


def test_topics_with_several_publishers_are_told() -> None:
    seen = seen_in([publisher(WRENCH), publisher(WRENCH, node="ft"), publisher(WRENCH, 7)])
    assert shared([WRENCH], seen, 7) == []
    assert shared([WRENCH], seen, 0) == ["/r1/wrench has 2 publishers, nodes /arm, /ft: expected one, end the others"]


def test_topics_with_the_same_reason_share_a_line() -> None:
    other = typed_topic("/r2/wrench", WRENCH.kind)
    seen = seen_in([publisher(WRENCH), publisher(other)])
    assert reasons([WRENCH, other], seen, 0) == [
        "/r1/wrench, /r2/wrench: node /arm has a publisher, but nothing comes from it"
    ]


def test_namespaces_are_parts_of_keys_and_tokens() -> None:
    node = Node(7, "943f9ebc", "talker", namespace_of("cell_1/left/"))
    assert node.token() == "@ros2_lv/7/943f9ebc/0/0/NN/%/%cell_1%left/talker"
    assert namespace_of("") == namespace_of("/") == ""
    with pytest.raises(CoheftError, match=r"--namespace 'my-cell': expected letters"):
        namespace_of("my-cell")


def test_two_bridges_do_not_share_a_namespace() -> None:
    port = free_port()
    with router(port), open_node("coheft", f"tcp/127.0.0.1:{port}", 0) as first:
        first.check_alone(["coheft"])
        for domain, namespace in ((0, "/cell"), (1, "")):
            with open_node("coheft", f"tcp/127.0.0.1:{port}", domain, namespace) as other:
                other.check_alone(["coheft"])
        with open_node("coheft", f"tcp/127.0.0.1:{port}", 0) as second:
            with pytest.raises(LinkError, match=r"node /coheft is in ROS domain 0 already, .* choose --namespace NAME"):
                second.check_alone(["coheft"])
            second.publish("/r1/wrench", ros.wrench(1, "r1", np.zeros(6)))
            second.seen()  # whose answer comes after the router has heard of the topic
            (topic,) = [each for each in first.seen() if each.topic]
            assert (topic.node, topic.topic, topic.kind) == ("/coheft", "/r1/wrench", WRENCH.kind)
            assert topic.type_hash == WRENCH.type_hash
