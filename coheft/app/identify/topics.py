"""Assignment of topics to robots, by ``--topics`` or by the topics' names."""

import re
from collections.abc import Mapping, Sequence
from itertools import takewhile

from coheft.app.identify.bags import IN_PLACE_OF_POSES, KINDS, BagTopic
from coheft.errors import RecordingError, one_line
from coheft.wire.process.log import LOG

Chosen = Mapping[str, Mapping[str, str]]
"""Names of topics by robot and channel."""
_OURS = re.compile(r"/([^/]+)/measured/(?:wrench|twist|acceleration)")
_HOW = (
    "Name them: --topics ROBOT=TOPIC …, for instance --topics left=/left/wrench left=/left/pose right=/right/wrench …"
)


def named_topics(topics: Sequence[BagTopic], given: Sequence[str]) -> Chosen:
    """Topics that ``--topics`` names, each as ``ROBOT=TOPIC``, or ``ROBOT=TOPIC,TOPIC``.

    Raises:
        RecordingError: A topic does not exist or cannot be used; the message lists all topics.
    """
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
                raise RecordingError(
                    f"--topics: {topic.words} cannot be used; expected one of {_kinds()}. {_listed(topics)}"
                )
            _add(chosen, robot, topic)
    if not _is_team(chosen):
        raise RecordingError(
            f"--topics: found {_each(chosen)}; expected at least two robots that measure the same, wrenches and poses. "
            f"{_listed(topics)}"
        )
    return chosen


def found_topics(topics: Sequence[BagTopic]) -> Chosen:
    """Topics by robot, according to the begin of their names; those of a run of coheft if there are any.

    Raises:
        RecordingError: Names do not tell; the message lists all topics.
    """
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


def _is_team(chosen: Chosen) -> bool:
    """Whether at least two robots measure the same, and enough of it."""
    channels = {frozenset(own) for own in chosen.values()}
    return (
        len(chosen) > 1 and len(channels) == 1 and all("wrench" in own and own & {"pose", "twist"} for own in channels)
    )


def _each(chosen: Chosen) -> str:
    return one_line("; ".join(f"{robot}: {', '.join(own)}" for robot, own in chosen.items()) or "none")


def _kinds() -> str:
    return ", ".join(kind.replace("/msg/", "/") for kind in KINDS)


def _listed(topics: Sequence[BagTopic]) -> str:
    """All topics, in words."""
    usable = [topic.words for topic in topics if topic.kind in KINDS]
    others = sorted({one_line(topic.kind.replace("/msg/", "/")) for topic in topics if topic.kind not in KINDS})
    text = f"Topics that could be used: {', '.join(usable) or 'none'}"
    return text + (f"; there are also messages of types {', '.join(others)}, which cannot be" if others else "") + "."
