"""Names of ROS 2 nodes on rmw_zenoh in Zenoh: keys of topics, tokens of the graph, attachments of messages.

As rmw_zenoh's design.md and sources have it from version 0.2.4 (Jazzy) and 0.6.0 (Kilted) on; before, attachments
were different.
"""

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from coheft.errors import CoheftError

_TOKEN = re.compile(r"[A-Za-z]([A-Za-z0-9]|_(?!_))*")
_ATTACHMENT = struct.Struct("<qqB16s")
GID_SIZE = 16

Endpoint = Literal["MP", "MS"]
"""A publisher, or a subscription."""


@dataclass(frozen=True)
class Topic:
    """A topic of one type.

    Attributes:
        name: Name, such as ``/r3/payload``.
        kind: Type, such as ``geometry_msgs/msg/InertiaStamped``.
        type_hash: Hash of the type's definition, ``RIHS01_`` and 64 hexadecimal digits.
        latched: Whether late subscribers receive the last message (transient local durability).
    """

    name: str
    kind: str
    type_hash: str
    latched: bool = False

    def key(self, domain: int) -> str:
        """Key of its messages."""
        package, _, name = self.kind.split("/")
        return f"{domain}/{self.name.strip('/')}/{package}::msg::dds_::{name}_/{self.type_hash}"

    @property
    def quality(self) -> str:
        """Quality of service where it differs from the default: durability; depth of the history."""
        return ":1:,1:,:,:,," if self.latched else "::,10:,:,:,,"


@dataclass(frozen=True)
class Node:
    """A node, the only one of its session, in a namespace such as ``/cell``; empty if there is none."""

    domain: int
    session: str
    name: str
    namespace: str = ""

    def token(self) -> str:
        """Token that announces the node."""
        return f"{self._prefix}/0/NN/{self._place}"

    def endpoint_token(self, number: int, kind: Endpoint, topic: Topic) -> str:
        """Return the token that announces a publisher or subscription; ``number`` is unique in this session."""
        mangled = topic.name.replace("/", "%")
        # The parts of a topic's key that follow its name are repeated here.
        typed = topic.key(self.domain).split("/")[-2:]
        return "/".join([f"{self._prefix}/{number}/{kind}/{self._place}", mangled, *typed, topic.quality])

    @property
    def _place(self) -> str:
        """Enclave, namespace and name."""
        return f"%/{self.namespace.replace('/', '%') or '%'}/{self.name}"

    @property
    def _prefix(self) -> str:
        return f"@ros2_lv/{self.domain}/{self.session}/0"


def attachment(sequence: int, time: int, gid: bytes) -> bytes:
    """Return the attachment of a message: its number from 1, time of sending [ns], and the publisher's identity."""
    return _ATTACHMENT.pack(sequence, time, GID_SIZE, gid)


def check_ros_names(robots: Iterable[str]) -> None:
    """Check that robots' names can be parts of topic names; raise ``CoheftError`` if ROS does not allow one."""
    for name in robots:
        if not _TOKEN.fullmatch(name) or name.endswith("_"):
            raise CoheftError(
                f"robot {name!r} cannot be in the name of a ROS topic: expected letters, digits and single '_', a "
                "letter first and no '_' last"
            )


def namespace_of(text: str) -> str:
    """Return a namespace as a prefix, ``/cell`` for ``cell`` or ``/cell/``, or empty; ``CoheftError`` if ROS does not
    allow it.
    """
    parts = [part for part in text.split("/") if part]
    for part in parts:
        if not _TOKEN.fullmatch(part):
            raise CoheftError(f"--namespace {text!r}: expected letters, digits and single '_', as in cell_1/left")
    return "".join(f"/{part}" for part in parts)
