"""Reading of a team's recording from a file of topics, which ``--topics`` or their names assign to robots."""

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile
from pathlib import Path

import msgspec
import numpy as np

from coheft.app.identify.bags import IN_PLACE_OF_POSES, KINDS, Bag, BagTopic
from coheft.app.recording.reader import Recording as Run
from coheft.app.recording.reader import read_recording as read_run
from coheft.errors import RecordingError, one_line, recording_errors
from coheft.estimation.batch.recording import Recording, Truth, check_recording
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.data.times import align
from coheft.wire.messages.truth import Truth as TruthMessage
from coheft.wire.process.log import LOG
from coheft.wire.scenario.schema import Scenario

_Chosen = Mapping[str, Mapping[str, str]]
"""Names of topics by robot and channel."""
_OURS = re.compile(r"/([^/]+)/measured/(?:wrench|twist|acceleration)")
_HOW = (
    "Name them: --topics ROBOT=TOPIC …, for instance --topics left=/left/wrench left=/left/pose right=/right/wrench …"
)
_STATUS = "/coheft/status"


def read_topics(path: Path, topics: Sequence[str]) -> Recording:
    """Read a recording from an MCAP file, or a bag of ROS."""
    with recording_errors(path):
        with Bag.open(path) as bag:
            chosen = _named_topics(bag.topics, topics) if topics else _found_topics(bag.topics)
            streams = bag.streams({name for own in chosen.values() for name in own.values()})
            is_ours = any(topic.name == _STATUS for topic in bag.topics)
        if not topics and not is_ours:
            each = "; ".join(f"{robot}: {', '.join(own.values())}" for robot, own in chosen.items())
            LOG.warning(f"coheft: topics are taken, by their names, for those of {one_line(each)}")
        robots, _ = align(
            {robot: {channel: streams[name] for channel, name in own.items()} for robot, own in chosen.items()}
        )
        recording = Recording(robots)
        check_recording(recording)
    return _with_truth(recording, read_run(path)) if is_ours and not topics else recording


def _with_truth(recording: Recording, run: Run) -> Recording:
    """Add the sensors' noise and the truth from a recorded run of coheft."""
    scene = run.begin.scene
    try:
        scenario = msgspec.json.decode(run.scenario, type=Scenario)
    except msgspec.DecodeError as error:
        LOG.warning(f"coheft: the scenario is damaged, or of another version: noise and truth are not used ({error})")
        return recording
    order = [scene.robots.index(name) for name in recording.names]
    grasps = [Pose(scene.rotations[k], scene.translations[k]) for k in order]
    to_first = grasps[0].inverse()
    loads: list[tuple[float, Inertia]] = []
    for _, news in run.news:
        if isinstance(news, TruthMessage):
            payload = news.payload
            load = Inertia(payload.mass, payload.com, payload.tensor).transported(to_first)
            if not loads or not np.allclose(load.barycentric(), loads[-1][1].barycentric(), rtol=1e-9, atol=0.0):
                loads.append((news.time - scenario.block_duration, load))
    truth = Truth(tuple(to_first @ grasp for grasp in grasps), tuple(loads))
    sensors = dict(zip(scenario.robot_names, scenario.robot_sensors(), strict=True))
    return Recording(
        {name: sensors[name].recorded(robot) for name, robot in recording.robots.items()},
        noise=None if scenario.sensors.encoders or scenario.sensors.of else scenario.noise,
        truth=truth,
    )


def _named_topics(topics: Sequence[BagTopic], given: Sequence[str]) -> _Chosen:
    """Topics that ``--topics`` names, each as ``ROBOT=TOPIC``, or ``ROBOT=TOPIC,TOPIC``."""
    chosen: dict[str, dict[str, str]] = {}
    by_name = {topic.name: topic for topic in topics}
    for item in given:
        robot, equals, names = item.partition("=")
        if not robot or not equals or not names:
            raise RecordingError(f"--topics: found '{one_line(item)}', expected ROBOT=TOPIC. {_listed(topics)}")
        for name in names.split(","):
            topic = by_name.get(name) or by_name.get(f"/{name}")
            if topic is None:
                raise RecordingError(f"--topics: there is no topic '{one_line(name)}'. {_listed(topics)}")
            if topic.kind not in KINDS:
                kinds = ", ".join(kind.replace("/msg/", "/") for kind in KINDS)
                raise RecordingError(
                    f"--topics: {topic.words} cannot be used; expected one of {kinds}. {_listed(topics)}"
                )
            _add(chosen, robot, topic)
    if not _is_team(chosen):
        raise RecordingError(
            f"--topics: found {_each(chosen)}; expected at least two robots that measure the same, wrenches and poses. "
            f"{_listed(topics)}"
        )
    return chosen


def _found_topics(topics: Sequence[BagTopic]) -> _Chosen:
    """Topics by robot, according to the begin of their names; those of a run of coheft if there are any."""
    usable = [topic for topic in topics if topic.kind in KINDS and topic.count]
    chosen: dict[str, dict[str, str]] = {}
    ours = [topic for topic in usable if _OURS.fullmatch(topic.name)]
    parts = {topic.name: topic.name.strip("/").split("/") for topic in usable}
    levels = zip(*(own[:-1] for own in parts.values()), strict=False)
    shared = sum(1 for _ in takewhile(lambda level: len(set(level)) == 1, levels))
    for topic in sorted(ours or usable, key=lambda topic: topic.kind in IN_PLACE_OF_POSES):
        robot = parts[topic.name][0 if ours else shared]
        if topic.kind not in IN_PLACE_OF_POSES or "pose" not in chosen.get(robot, {}):
            _add(chosen, robot, topic)
    others = {robot: own for robot, own in chosen.items() if "wrench" not in own}  # tables, cameras or targets
    chosen = {robot: own for robot, own in chosen.items() if "wrench" in own}
    if others and len(chosen) > 1:
        LOG.warning(
            f"coheft: left out, for there is no wrench beside them: {_each(others)}; if one of these is a robot that "
            f"holds the load, its force is missing, and the results are wrong"
        )
    if not _is_team(chosen):
        raise RecordingError(
            f"found robots by the names of topics: {_each(chosen)}; expected at least two that measure the same, "
            f"wrenches and poses. {_HOW} {_listed(topics)}"
        )
    return chosen


def _add(chosen: dict[str, dict[str, str]], robot: str, topic: BagTopic) -> None:
    own, channel = chosen.setdefault(robot, {}), KINDS[topic.kind][0]
    if own.setdefault(channel, topic.name) != topic.name:
        raise RecordingError(
            f"{one_line(own[channel])} and {one_line(topic.name)} both tell the {channel} of {one_line(robot)}, "
            f"expected one. {_HOW}"
        )


def _is_team(chosen: _Chosen) -> bool:
    """Whether at least two robots measure the same, and enough of it."""
    channels = {frozenset(own) for own in chosen.values()}
    return (
        len(chosen) > 1 and len(channels) == 1 and all("wrench" in own and own & {"pose", "twist"} for own in channels)
    )


def _each(chosen: _Chosen) -> str:
    return one_line("; ".join(f"{robot}: {', '.join(own)}" for robot, own in chosen.items()) or "none")


def _listed(topics: Sequence[BagTopic]) -> str:
    """All topics, in words."""
    usable = [topic.words for topic in topics if topic.kind in KINDS]
    others = sorted({one_line(topic.kind.replace("/msg/", "/")) for topic in topics if topic.kind not in KINDS})
    text = f"Topics that could be used: {', '.join(usable) or 'none'}"
    return text + (f"; there are also messages of types {', '.join(others)}, which cannot be" if others else "") + "."
