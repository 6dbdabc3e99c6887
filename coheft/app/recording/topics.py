"""Messages of a run as ROS 2 messages by topic: the truth, measurements, estimates, and errors of these."""

from collections.abc import Iterator, Sequence

import numpy as np

from coheft.app.recording import ros
from coheft.app.recording.ros import RosMessage
from coheft.app.results.judge import Judge, PoseReport, standard_deviations
from coheft.app.results.states import State
from coheft.estimation.geometry.spatial import Pose, quaternion_from_rotation
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.structs import Estimate, PayloadEstimate, Validity
from coheft.wire.messages.truth import LoadState, Scene, Truth
from coheft.wire.scenario.payload import Payload
from coheft.wire.scenario.section import pose_of

WORLD = "world"
PAYLOAD = "payload"
_GREY, _ORANGE = (0.6, 0.6, 0.65, 0.6), (1.0, 0.5, 0.1, 0.9)
_LEVELS = {Validity.STARTING: ros.DOUBTFUL, Validity.VALID: ros.OK, Validity.STALE: ros.STALE}


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


def estimate_messages(time: int, estimate: Estimate, total_time: int) -> Iterator[tuple[str, RosMessage]]:
    """Yield the messages of an estimate by topic.

    ``time`` is the end of its block, ``total_time`` that of the sample to which its total wrench belongs [ns].
    """
    name, payload = estimate.robot, estimate.payload
    if payload is not None:
        yield f"/{name}/estimate/payload", ros.inertia(time, name, payload.mass, payload.com, payload.tensor)
    for other, found in estimate.poses.items():
        pose = Pose(found.rotation, found.translation)
        yield f"/{name}/estimate/poses/{other}", ros.pose_with_covariance(time, name, pose, found.covariance)
    if estimate.total_block >= 0:
        yield f"/{name}/estimate/total_wrench", ros.wrench(total_time, name, estimate.total_wrench)
    values = [
        ("estimator", estimate.estimator),
        ("phase", estimate.phase),
        ("converged", estimate.converged),
        ("members of the team", estimate.members),
        ("messages refused", estimate.problems),
        *(("reason", reason) for reason in estimate.reasons),
        *(("not observable", what) for what in estimate.not_observable),
    ]
    yield "/diagnostics", ros.diagnostics(time, name, _LEVELS[estimate.status], State.of(estimate), values)


def error_messages(time: int, estimate: Estimate, judge: Judge, total_time: int) -> Iterator[tuple[str, RosMessage]]:
    """Yield the errors (estimate minus truth) of an estimate by topic; the judge has the truth of its block.

    Times are as of ``estimate_messages``.
    """
    name = estimate.robot
    if estimate.payload is not None:
        yield from _payload_messages(time, estimate.payload, name, judge.payload(name, estimate.block))
    truth = judge.total_wrench(name, estimate.total_block)
    if truth is not None:
        yield f"/{name}/error/total_wrench", ros.wrench(total_time, name, estimate.total_wrench - truth)
    for other, off in judge.pose_errors(estimate).items():
        error, covariance = PoseReport.of(off), estimate.poses[other].covariance
        yield f"/{name}/error/poses/{other}/rotation_deg", ros.number(error.rotation_error_deg)
        yield f"/{name}/error/poses/{other}/translation_mm", ros.number(error.translation_error_mm)
        rotation, translation = np.sqrt([np.trace(covariance[:3, :3]), np.trace(covariance[3:, 3:])]).tolist()
        yield f"/{name}/three_sigma/poses/{other}/rotation_deg", ros.number(3.0 * float(np.degrees(rotation)))
        yield f"/{name}/three_sigma/poses/{other}/translation_mm", ros.number(3e3 * translation)


def _payload_messages(
    time: int, claimed: PayloadEstimate, name: str, truth: Inertia
) -> Iterator[tuple[str, RosMessage]]:
    com = None if claimed.com is None else claimed.com - truth.com
    tensor = None if claimed.tensor is None else claimed.tensor - truth.tensor
    yield f"/{name}/error/payload", ros.inertia(time, name, claimed.mass - truth.mass, com, tensor)
    spread = 3.0 * standard_deviations(claimed)
    com = None if claimed.com is None else spread[1:4]
    tensor = None if claimed.tensor is None else unpack_symmetric(spread[4:])
    yield f"/{name}/three_sigma/payload", ros.inertia(time, name, float(spread[0]), com, tensor)
