"""A ROS 2 node on rmw_zenoh with publishers and subscriptions."""

import json
import os
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh
import zenoh.ext

from coheft.app.recording import ros
from coheft.app.ros2.graph import EVERYTHING, Seen, seen_in
from coheft.app.ros2.names import GID_SIZE, Node, Topic, attachment
from coheft.errors import LinkError
from coheft.wire.transport.sessions import session_id

_HEARTBEAT = 1.0
_PATIENCE = 1.0
"""Time to wait for the router's answer about nodes and publishers [s]."""


class RosNode:
    """Publishes and receives standard messages, see ``open_node``; ``published`` counts those with a subscriber."""

    def __init__(self, session: zenoh.Session, domain: int, name: str, namespace: str) -> None:
        self.topics: dict[str, Publisher] = {}
        self.published = 0
        self.domain = domain
        self._session = session
        self._node = Node(domain, session_id(session), name, namespace)
        self._kept: list[Any] = []  # tokens and subscribers, which end when they are no longer referenced
        self._announce(self._node.token())

    @property
    def has_router(self) -> bool:
        """Whether the link with the router is up."""
        return bool(self._session.info.routers_zid())

    @property
    def name(self) -> str:
        """Name of the node, with its namespace: ``/cell/coheft``."""
        return f"{self._node.namespace}/{self._node.name}"

    def full(self, topic: str) -> str:
        """Return a topic's name with the namespace: ``/cell/r3/payload``."""
        return self._node.namespace + topic

    def seen(self) -> list[Seen]:
        """Return other nodes and publishers in all domains, as far as the router knows them."""
        replies = self._session.liveliness().get(EVERYTHING, timeout=_PATIENCE)
        tokens = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return [each for each in seen_in(tokens) if each.session != self._node.session]

    def check_alone(self, names: Collection[str]) -> None:
        """Raise a ``LinkError`` if a node with one of these names is in this domain and namespace: topics would be
        mixed.
        """
        own = {f"{self._node.namespace}/{name}" for name in names}
        for other in self.seen():
            if other.domain == self.domain and not other.topic and other.node in own:
                raise LinkError(
                    f"node {other.node} is in ROS domain {self.domain} already, and nodes would hear both on the same "
                    f"topics: end it, or choose --namespace NAME, or another --domain"
                )

    def publish(self, topic: str, message: ros.RosMessage, *, latched: bool = False) -> None:
        """Publish a message on a topic such as ``/r3/payload``; all messages of a topic must have the same type.

        A ``latched`` one is kept for late subscribers.
        """
        topic = self.full(topic)
        if topic not in self.topics:
            typed = typed_topic(topic, message.__msgtype__, latched=latched)
            self.topics[topic] = Publisher(self._session, typed.key(self._node.domain), latched=latched)
            self._announce(self._node.endpoint_token(len(self._kept), "MP", typed))
        self.published += self.topics[topic].publish(message)

    def listen(self, topic: str, kind: str, receive: Callable[[bytes], None]) -> None:
        """Subscribe to the messages of a topic, of a type such as ``geometry_msgs/msg/WrenchStamped``.

        ``receive`` is called with each of them, as CDR, in a thread of Zenoh's.
        """
        typed = typed_topic(self.full(topic), kind)
        handler: Any = zenoh.handlers.Callback(lambda sample: receive(sample.payload.to_bytes()), indirect=False)
        self._kept.append(self._session.declare_subscriber(typed.key(self._node.domain), handler))
        self._announce(self._node.endpoint_token(len(self._kept), "MS", typed))

    def _announce(self, token: str) -> None:
        self._kept.append(self._session.liveliness().declare_token(token))


class Publisher:
    """Publisher of one topic; ``latched`` keeps the last message for late subscribers."""

    def __init__(self, session: zenoh.Session, key: str, *, latched: bool) -> None:
        options: dict[str, Any] = {"congestion_control": zenoh.CongestionControl.DROP}
        self._latched = latched
        self._publisher: Any
        if latched:
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session,
                key,
                cache=zenoh.ext.CacheConfig(1),
                publisher_detection=True,
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=_HEARTBEAT),
                **options,
            )
        else:
            self._publisher = session.declare_publisher(key, **options)
        self._gid = os.urandom(GID_SIZE)
        self._sequence = 0

    def publish(self, message: ros.RosMessage) -> bool:
        """Publish a message if there is a subscriber or it is latched; return whether it was published."""
        if not (self._latched or self._publisher.matching_status.matching):
            return False
        self._sequence += 1
        extra = attachment(self._sequence, time.time_ns(), self._gid)
        self._publisher.put(bytes(ros.to_cdr(message)), attachment=extra)
        return True


@contextmanager
def open_node(name: str, endpoint: str, domain: int, namespace: str = "") -> Iterator[RosNode]:
    """Open a node that is linked with a router of ROS 2, and through it with all other nodes, while the context lasts.

    It raises a ``LinkError`` if no router listens there; one that goes later is dialled again in the background.
    """
    settings = {
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},  # latched messages are ordered by time
    }
    try:
        session = zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))
    except zenoh.ZError as error:
        raise LinkError(
            f"no router of ROS 2 at {endpoint}: start one with 'ros2 run rmw_zenoh_cpp rmw_zenohd', "
            f"or say where it is: --endpoint tcp/HOST:7447"
        ) from error
    with session:
        yield RosNode(session, domain, name, namespace)


def typed_topic(topic: str, kind: str, *, latched: bool = False) -> Topic:
    """Make a topic of a standard type, such as ``geometry_msgs/msg/WrenchStamped``."""
    return Topic(topic, kind, ros.type_hash(kind), latched)
