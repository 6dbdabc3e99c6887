"""A ROS 2 node as somebody else makes it, with zenoh-ros2-sdk: says what it hears and sees, in lines of JSON.

Arguments: the router's port, then topics to listen to as NAME=TYPE, or NAME=TYPE=QOS in rmw_zenoh's notation.
"""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import asdict
from typing import Any

from rosbags.typesys import Stores, get_typestore
from zenoh_ros2_sdk import ROS2Subscriber, get_topic_names_and_types

STORE = get_typestore(Stores.ROS2_KILTED)


def say(what: dict[str, Any]) -> None:
    """One line in one piece: each topic is heard in a thread of its own."""
    line = json.dumps(what, default=lambda array: array.tolist())
    os.write(sys.stdout.fileno(), f"{line}\n".encode())


def listen(port: int, topic: str, kind: str, quality: str | None = None) -> ROS2Subscriber:
    def receive(message: Any) -> None:
        say({"topic": topic, "message": asdict(message)})

    definition, _ = STORE.generate_msgdef(kind, ros_version=2)
    return ROS2Subscriber(
        topic,
        kind,
        receive,
        msg_definition=definition,
        type_hash=STORE.hash_rihs01(kind),
        router_port=port,
        domain_id=0,
        qos=quality,
    )


def main() -> None:
    port = int(sys.argv[1])
    kept = [listen(port, *topic.split("=")) for topic in sys.argv[2:]]
    while kept:
        topics = get_topic_names_and_types(domain_id=0, router_port=port, timeout=2.0)
        say({"topics": dict(topics)})
        time.sleep(0.5)


if __name__ == "__main__":
    main()
