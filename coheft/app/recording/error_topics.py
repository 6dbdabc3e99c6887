"""How far a robot's estimate is off, beside three of its own standard deviations, as ROS 2 messages by topic."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coheft.app.recording import ros
from coheft.app.recording.ros import RosMessage
from coheft.app.results.judge import Judge, standard_deviations
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import unpack_symmetric
from coheft.wire.messages.structs import Estimate, PayloadEstimate


def error_messages(time: int, estimate: Estimate, judge: Judge, total_time: int) -> Iterator[tuple[str, RosMessage]]:
    """Errors (estimate minus truth) of an estimate; the judge knows the truth of its block.

    Args:
        time: End of the block [ns].
        estimate: What a robot believes.
        judge: Who knows.
        total_time: When the sample was taken to which its total wrench belongs [ns].
    """
    name = estimate.robot
    if estimate.payload is not None:
        yield f"/{name}/error/payload", _payload_error(time, estimate, estimate.payload, judge)
        yield f"/{name}/three_sigma/payload", _payload_spread(time, name, estimate.payload)
    truth = judge.total_wrench(name, estimate.total_block)
    if truth is not None:
        yield f"/{name}/error/total_wrench", ros.wrench(total_time, name, estimate.total_wrench - truth)
    for other, pose in estimate.poses.items() if estimate.phase == "inertia" else ():
        error = judge.pose_error(name, other, pose, estimate.block)
        yield f"/{name}/error/poses/{other}/rotation_deg", ros.number(error.rotation_error_deg)
        yield f"/{name}/error/poses/{other}/translation_mm", ros.number(error.translation_error_mm)
        rotation, translation = _length_spread(pose.covariance[:3, :3]), _length_spread(pose.covariance[3:, 3:])
        yield f"/{name}/three_sigma/poses/{other}/rotation_deg", ros.number(3.0 * float(np.degrees(rotation)))
        yield f"/{name}/three_sigma/poses/{other}/translation_mm", ros.number(3e3 * translation)


def _payload_error(time: int, estimate: Estimate, claimed: PayloadEstimate, judge: Judge) -> RosMessage:
    truth = judge.payload(estimate.robot, estimate.block)
    com = None if claimed.com is None else claimed.com - truth.com
    tensor = None if claimed.tensor is None else claimed.tensor - truth.tensor
    return ros.inertia(time, estimate.robot, claimed.mass - truth.mass, com, tensor)


def _payload_spread(time: int, frame: str, claimed: PayloadEstimate) -> RosMessage:
    spread = 3.0 * standard_deviations(claimed)
    com = None if claimed.com is None else spread[1:4]
    tensor = None if claimed.tensor is None else unpack_symmetric(spread[4:])
    return ros.inertia(time, frame, float(spread[0]), com, tensor)


def _length_spread(covariance: Array) -> float:
    """Root mean square length of a vector of such a covariance (3, 3)."""
    return float(np.sqrt(np.trace(covariance)))
