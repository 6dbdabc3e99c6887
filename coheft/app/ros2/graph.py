"""Nodes and publishers in ROS 2 according to liveliness tokens, and reasons why messages on a topic may be missing."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from coheft.app.ros2.names import Topic
from coheft.errors import one_line

EVERYTHING = "@ros2_lv/**"
"""Key of all tokens."""
_PREFIX = "@ros2_lv"
_PARTS_OF_NODE, _PARTS_OF_ENDPOINT = 9, 12
_SHOWN = 8
"""Largest number of other topics that are named."""


@dataclass(frozen=True)
class Seen:
    """A node, or one of its publishers.

    Attributes:
        node: Name of the node, with its namespace: ``/cell/talker``.
        topic: Topic that it publishes; empty for the node itself.
        kind: Type of the messages, such as ``geometry_msgs/msg/Wrench``.
        type_hash: Hash of the type's definition, as given by the node.
    """

    domain: int
    session: str
    node: str
    topic: str = ""
    kind: str = ""
    type_hash: str = ""


def seen_in(tokens: Iterable[str]) -> list[Seen]:
    """Return the nodes and publishers among tokens; other tokens, and those of other versions, are ignored."""
    found = []
    for token in tokens:
        parts = token.split("/")
        if len(parts) < _PARTS_OF_NODE or parts[0] != _PREFIX or not parts[1].isdecimal():
            continue
        node = f"{_unmangled(parts[7]).rstrip('/')}/{parts[8]}"
        if parts[5] == "NN" and len(parts) == _PARTS_OF_NODE:
            found.append(Seen(int(parts[1]), parts[2], node))
        elif parts[5] == "MP" and len(parts) >= _PARTS_OF_ENDPOINT:
            kind = parts[10].replace("::msg::dds_::", "/msg/").removesuffix("_")
            found.append(Seen(int(parts[1]), parts[2], node, _unmangled(parts[9]), kind, parts[11]))
    return found


def shared(topics: Sequence[Topic], seen: Sequence[Seen], domain: int) -> list[str]:
    """Describe topics that several nodes publish, whose messages are mixed; arguments as of ``reasons``."""
    lines = []
    for topic in topics:
        nodes = sorted(one_line(each.node) for each in seen if each.topic == topic.name and each.domain == domain)
        if len(nodes) > 1:
            lines.append(
                f"{topic.name} has {len(nodes)} publishers, nodes {', '.join(nodes)}: expected one, end the others"
            )
    return lines


def reasons(
    silent: Sequence[Topic], seen: Sequence[Seen], domain: int, own: Collection[str] = frozenset()
) -> list[str]:
    """Describe why no messages arrive on some topics: a line for each reason, with all topics to which it applies.

    Messages are expected in one domain; ``own`` are the names of all topics that are expected, also those with
    messages.
    """
    publishers = [each for each in seen if each.topic]
    if not publishers:
        return [
            f"{', '.join(topic.name for topic in silent)}: no node publishes anything by this router: do nodes run, "
            f"with RMW_IMPLEMENTATION=rmw_zenoh_cpp?"
        ]
    lines: dict[str, list[str]] = {}
    for topic in silent:
        lines.setdefault(_reason(topic, publishers, domain, own), []).append(topic.name)
    return [f"{', '.join(names)}: {reason}" for reason, names in lines.items()]


def _reason(topic: Topic, publishers: Sequence[Seen], domain: int, own: Collection[str]) -> str:
    expected = _short(topic.kind)
    same_name = [each for each in publishers if each.topic == topic.name]
    here = [each for each in same_name if each.domain == domain]
    for each in here:
        if (each.kind, each.type_hash) == (topic.kind, topic.type_hash):
            return f"{_node(each)} has a publisher, but nothing comes from it"
    for each in here:
        if each.kind != topic.kind:
            stamp = ", which has no stamp" if f"{each.kind}Stamped" == topic.kind else ""
            return f"{_node(each)} publishes {_short(each.kind)}{stamp}; expected {expected}"
    for each in here:
        unknown = " (as in Humble)" if not each.type_hash.startswith("RIHS01_") else ""
        return (
            f"{_node(each)} publishes {expected} with the type hash {one_line(each.type_hash)}{unknown}; expected "
            f"{topic.type_hash}, which is that of Jazzy and later"
        )
    for each in same_name:
        return f"{_node(each)} publishes in ROS domain {each.domain}, expected {domain}: choose it with --domain"
    elsewhere = sorted({each.topic for each in publishers if each.domain == domain and each.topic.endswith(topic.name)})
    if elsewhere:
        namespace = one_line(elsewhere[0].removesuffix(topic.name))
        return (
            f"not published, but {', '.join(map(one_line, elsewhere))} is: remap it, or choose --namespace {namespace}"
        )
    others = sorted(
        {
            each.topic
            for each in publishers
            if each.domain == domain and each.kind == topic.kind and each.topic not in own
        }
    )
    if others:
        more = " and others" if len(others) > _SHOWN else ""
        return f"not published; of type {expected} there is {', '.join(map(one_line, others[:_SHOWN]))}{more}: remap it"
    domains = sorted({each.domain for each in publishers})
    if domain in domains or not domains:
        return f"not published, nor anything else of type {expected}, in ROS domain {domain}"
    return f"not published: there is nothing in ROS domain {domain}, but in {', '.join(map(str, domains))}"


def _node(publisher: Seen) -> str:
    return f"node {one_line(publisher.node)}"


def _short(kind: str) -> str:
    return one_line(kind.replace("/msg/", "/"))


def _unmangled(name: str) -> str:
    return name.replace("%", "/")
