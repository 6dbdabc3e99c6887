"""The server's messages as ROS 2 messages by topic: the truth, and the measurements of every robot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from coheft.app.recording import ros
from coheft.app.recording.ros import RosMessage
from coheft.estimation.geometry.spatial import quaternion_from_rotation
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.wire.messages.scene import Scene
from coheft.wire.messages.truth import LoadState, Truth
from coheft.wire.scenario.payload import Payload
from coheft.wire.scenario.section import pose_of

WORLD = "world"
PAYLOAD = "payload"
_GREY, _ORANGE = (0.6, 0.6, 0.65, 0.6), (1.0, 0.5, 0.1, 0.9)


def scene_messages(time: int, scene: Scene) -> Iterator[tuple[str, RosMessage]]:
    """Yield the constant part of the scene: each robot's grasp."""
    grasps = zip(scene.robots, scene.translations, scene.rotations, strict=True)
    poses = {name: (position, quaternion_from_rotation(rotation)) for name, position, rotation in grasps}
    yield "/tf_static", ros.transforms(time, PAYLOAD, poses)


def box_messages(time: int, payload: Payload, loads: Sequence[LoadState]) -> Iterator[tuple[str, RosMessage]]:
    """Yield the boxes of the payload and its loads."""
    boxes = [ros.MarkedBox(box.pose(), box.size, _GREY) for box in payload.boxes]
    boxes += [ros.MarkedBox(pose_of(load.position, (0.0, 0.0, 0.0)), load.size, _ORANGE) for load in loads]
    yield "/payload/markers", ros.boxes(time, PAYLOAD, boxes)


def truth_messages(time: int, truth: Truth, scene: Scene) -> Iterator[tuple[str, RosMessage]]:
    """Yield the truth of the last sample of a block, taken at ``time`` [ns]."""
    yield "/tf", ros.transforms(time, WORLD, {PAYLOAD: (truth.position, truth.quaternion)})
    yield "/payload/pose", ros.pose(time, WORLD, truth.position, truth.quaternion)
    payload = truth.payload
    yield "/payload/inertia", ros.inertia(time, PAYLOAD, payload.mass, payload.com, payload.tensor)
    yield "/payload/total_wrench", ros.wrench(time, PAYLOAD, truth.total_wrench)
    for name, sample in zip(scene.robots, truth.samples, strict=True):
        yield f"/{name}/measured/wrench", ros.wrench(time, name, sample[WRENCH])
        yield f"/{name}/measured/twist", ros.twist(time, name, sample[TWIST])
        yield f"/{name}/measured/acceleration", ros.acceleration(time, name, sample[ACCELERATION])
