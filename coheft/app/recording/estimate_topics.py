"""A robot's estimate as ROS 2 messages by topic, in its own grasp frame."""

from __future__ import annotations

from collections.abc import Iterator

from coheft.app.recording import ros
from coheft.app.recording.ros import RosMessage
from coheft.app.results.states import State
from coheft.estimation.geometry.spatial import Pose
from coheft.wire.messages.states import Validity
from coheft.wire.messages.structs import Estimate

_LEVELS = {Validity.STARTING: ros.DOUBTFUL, Validity.VALID: ros.OK, Validity.STALE: ros.STALE}


def estimate_messages(time: int, estimate: Estimate, total_time: int) -> Iterator[tuple[str, RosMessage]]:
    """Yield the messages of an estimate by topic.

    Args:
        time: End of the block [ns].
        estimate: The estimate.
        total_time: Time of the sample to which its total wrench belongs [ns].
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
