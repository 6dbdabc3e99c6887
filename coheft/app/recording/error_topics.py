"""Errors of a robot's estimate, with three of its own standard deviations, as ROS 2 messages by topic."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from coheft.app.recording import ros
from coheft.app.recording.ros import RosMessage
from coheft.app.results.judge import Judge, PoseReport, standard_deviations
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.structs import Estimate, PayloadEstimate


def error_messages(time: int, estimate: Estimate, judge: Judge, total_time: int) -> Iterator[tuple[str, RosMessage]]:
    """Yield the errors (estimate minus truth) of an estimate by topic; the judge has the truth of its block.

    Args:
        time: End of the block [ns].
        estimate: The estimate.
        judge: Compares estimates with the truth.
        total_time: Time of the sample to which its total wrench belongs [ns].
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
        rotation, translation = _length_spread(covariance[:3, :3]), _length_spread(covariance[3:, 3:])
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


def _length_spread(covariance: Array) -> float:
    """Return the root mean square length of a vector with a covariance (3, 3)."""
    return float(np.sqrt(np.trace(covariance)))
