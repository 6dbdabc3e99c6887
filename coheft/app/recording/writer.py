"""What a recording holds: every message that an observer hears, and what it says as ROS 2 messages."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import version
from platform import python_version

import msgspec

import coheft
from coheft.app.heard import News
from coheft.app.recording import ros
from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.raw import to_raw
from coheft.app.recording.reader import SCENARIO, VERSIONS
from coheft.app.recording.ros import RosMessage
from coheft.app.recording.truth_topics import scene_messages, truth_messages
from coheft.wire.messages import Estimate, Message, Scene, Status, Truth
from coheft.wire.scenario import Scenario

_PACKAGES = {"mujoco": "mujoco", "numpy": "numpy", "zenoh": "eclipse-zenoh"}


class RunWriter:
    """Writes a run into an MCAP file, which is somebody else's to flush and to finish.

    Args:
        out: The file.
        scenario: What is run.
        scene: Who holds the payload where.
    """

    def __init__(self, out: McapFile, scenario: Scenario, begin: Status) -> None:
        self._out = out
        self._scene: Scene = begin.scene
        self._block, self._rate = scenario.sensors.block, scenario.sensors.rate
        self._newest = _nanoseconds(begin.time)
        out.describe(VERSIONS, _versions())
        out.attach(SCENARIO, "application/json", msgspec.json.format(msgspec.json.encode(scenario)))
        self._write_raw(self._newest, begin)
        self._write(self._newest, scene_messages(self._newest, begin.scene))

    def hear(self, news: News) -> None:
        """Write what an observer has heard."""
        time = self._newest
        if not isinstance(news, Estimate | Truth):
            self._write_raw(time, news)
            return
        time = _nanoseconds(news.time)
        self._newest = max(self._newest, time)
        self._write_raw(time, news)
        if isinstance(news, Truth):
            self._write(time, truth_messages(self._last_sample(news.block), news, self._scene))

    def _last_sample(self, block: int) -> int:
        """When the last sample of a block was taken [ns]."""
        return ((block + 1) * self._block - 1) * 10**9 // self._rate

    def _write_raw(self, time: int, message: Message) -> None:
        topic, data = to_raw(message)
        self._out.write(topic, time, ros.of_bytes(data))

    def _write(self, time: int, messages: Iterable[tuple[str, RosMessage]]) -> None:
        for topic, message in messages:
            self._out.write(topic, time, message)


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)


def _versions() -> dict[str, str]:
    """Of what decides on a run's numbers."""
    packages = {name: version(package) for name, package in _PACKAGES.items()}
    return {"coheft": coheft.__version__, "python": python_version(), **packages}
