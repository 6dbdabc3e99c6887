"""Content of a recording: every message that an observer receives, and its content as ROS 2 messages."""

from collections.abc import Iterable

import msgspec

from coheft.app.recording import ros
from coheft.app.recording.log_book import LogBook
from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.raw import to_raw
from coheft.app.recording.reader import BEGIN, SCENARIO
from coheft.app.recording.ros import RosMessage
from coheft.app.recording.topics import box_messages, error_messages, estimate_messages, scene_messages, truth_messages
from coheft.app.results.record import load_ids
from coheft.app.run.news import News
from coheft.app.run.pairing import Pairing
from coheft.app.versions import versions
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Estimate, EstimateBeside, Message, Problem
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.plugins import estimator_names
from coheft.wire.scenario.schema import Scenario


class RunWriter:
    """Writes the messages of a run to an MCAP file, which the caller flushes and completes.

    The log time of a message is the simulated time that it refers to; the time in its header is that of the sample.
    """

    def __init__(self, out: McapFile, scenario: Scenario, begin: Status) -> None:
        self._out = out
        self._scenario = scenario
        self._sample = 10**9 // scenario.sensors.rate
        self._scene = begin.scene
        own, *beside = estimator_names(begin.estimator)
        self._under = {own: "", **{name: f"/{name}" for name in beside}}
        self._pairing = Pairing(begin.scene, list(self._under))
        self._log = LogBook()
        self._loads: list[int] | None = None
        self._newest = _nanoseconds(begin.time)
        out.describe("versions", versions())
        out.attach(SCENARIO, "application/json", msgspec.json.format(msgspec.json.encode(scenario)))
        out.repeat(BEGIN, "application/msgpack", to_raw(begin)[1])
        self._write_raw(self._newest, begin)
        self._write(self._newest, scene_messages(self._newest, begin.scene))

    def receive(self, news: News) -> None:
        """Write a received message."""
        time = self._newest if isinstance(news, Problem) else _nanoseconds(news.time)
        self._newest = max(self._newest, time)
        self._write_raw(time, news)
        match news:
            case Truth():
                self._write_truth(time, news)
            case Estimate():
                self._write(time, estimate_messages(time, news, self._total_time(news)))
            case EstimateBeside(estimate=estimate) if estimate.estimator in self._under:
                messages = estimate_messages(time, estimate, self._total_time(estimate))
                self._write(time, messages, self._under[estimate.estimator])
        for name, estimate in self._pairing.receive(news):  # those whose truth has arrived
            end = _nanoseconds(estimate.time)
            messages = error_messages(end, estimate, self._pairing.judge, self._total_time(estimate))
            self._write(end, messages, self._under[name])
        for line in self._log.lines(news):
            self._out.write("/rosout", time, ros.log(time, *line))

    def _write_truth(self, time: int, truth: Truth) -> None:
        sampled = max(0, time - self._sample)
        self._write(time, truth_messages(sampled, truth, self._scene))
        loads = load_ids(truth)
        if loads != self._loads:
            self._loads = loads
            self._write(time, box_messages(sampled, self._scenario.payload, truth.loads))

    def _total_time(self, estimate: Estimate) -> int:
        """Return the time of the sample to which the total wrench of an estimate belongs [ns]."""
        age = (estimate.block - estimate.total_block) * self._scenario.block_duration
        return max(0, _nanoseconds(estimate.time - age) - self._sample)

    def _write_raw(self, time: int, message: Message) -> None:
        topic, data = to_raw(message)
        self._out.write(topic, time, ros.of_bytes(data))

    def _write(self, time: int, messages: Iterable[tuple[str, RosMessage]], under: str = "") -> None:
        """Write messages; topics of an estimator that runs beside the robots' own begin with its name, ``under``."""
        for topic, message in messages:
            self._out.write(under + topic, time, message)


def _nanoseconds(seconds: float) -> int:
    return round(seconds * 1e9)
