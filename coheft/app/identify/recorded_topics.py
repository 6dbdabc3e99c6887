"""Reading of a team's recording from a file of topics."""

from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from coheft.app.identify.bags import Bag
from coheft.app.identify.topics import found_topics, named_topics
from coheft.app.recording.reader import Recording as Run
from coheft.app.recording.reader import read_recording as read_run
from coheft.errors import one_line, recording_errors
from coheft.estimation.batch.recording import Recording, Truth, check_recording
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.data.common_times import align
from coheft.wire.messages.truth import Truth as TruthMessage
from coheft.wire.process.log import LOG
from coheft.wire.scenario.schema import Scenario

_STATUS = "/coheft/status"


def read_topics(path: Path, topics: Sequence[str]) -> Recording:
    """Read a recording from an MCAP file, or a bag of ROS.

    Args:
        path: The file, or the folder of a bag.
        topics: Topics of each robot, as ``ROBOT=TOPIC``; if there are none, the topics' names tell.

    Raises:
        RecordingError: It cannot be read, has other topics, or samples that are not valid.
    """
    with recording_errors(path):
        with Bag.open(path) as bag:
            chosen = named_topics(bag.topics, topics) if topics else found_topics(bag.topics)
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
            load = Inertia(payload.mass, payload.com, payload.tensor).carried(to_first)
            if not loads or not np.allclose(load.barycentric(), loads[-1][1].barycentric(), rtol=1e-9, atol=0.0):
                loads.append((news.time - scenario.block_duration, load))
    truth = Truth(tuple(to_first @ grasp for grasp in grasps), tuple(loads))
    sensors = dict(zip(scenario.robot_names, scenario.robot_sensors(), strict=True))
    return Recording(
        {name: sensors[name].recorded(robot) for name, robot in recording.robots.items()},
        noise=None if scenario.sensors.encoders or scenario.sensors.of else scenario.noise,
        truth=truth,
    )
