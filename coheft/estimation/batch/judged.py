"""What a judge says of a recording whose poses were fitted, and what each number may be off although all fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.hand_eye import HandEye
from coheft.estimation.batch.identification import HiddenError, Identification
from coheft.estimation.batch.identify import at_first_grasp, centre_of
from coheft.estimation.batch.judge.forces import judge_forces
from coheft.estimation.batch.judge.mend import MENDABLE
from coheft.estimation.batch.judge.poses import judge_poses
from coheft.estimation.batch.judge.sensors import stuck_sensor
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals


def judge(
    recording: Recording,
    signals: Signals,
    grasps: HandEye,
    cutoff: float,
    *,
    is_suspicious: bool = False,
    assumed: str | None = None,
) -> Verdict | None:
    """Judge sensors, poses and, if poses are known and those of one load, forces.

    Args:
        recording: With poses and wrenches alone.
        signals: Of it, filtered.
        grasps: Fitted to its poses.
        cutoff: Of the filter [Hz].
        is_suspicious: Whether poses do not fit together: then forces say nothing.
        assumed: The cause that the user names; None: the one that explains most.
    """
    team = grasps.team
    relative = [team.relative(0, other) for other in range(1, len(team.poses))]
    if any(pose.unseen for pose in relative) or not recording.gravity.any():  # nothing has a weight there
        return None
    at_first_sight = stuck_sensor(recording)
    if at_first_sight is not None:
        return at_first_sight
    centre = centre_of(team.poses)
    poses = [centre.inverse() @ pose for pose in team.poses]
    by_poses = judge_poses(recording, signals, grasps.homes, poses)
    if by_poses is not None or is_suspicious:
        return by_poses
    turns = max(float(np.sqrt(np.linalg.eigvalsh(pose.covariance[:3, :3])[-1])) for pose in relative)
    return judge_forces(recording, signals, poses, turns, cutoff, assumed)


def check_assumption(verdict: Verdict | None, cause: str) -> Verdict:
    """The verdict, if its cause is the one that the user names.

    Raises:
        RecordingError: It is not; says what it is.
    """
    if verdict is None:
        raise RecordingError(f"--assume {cause}: the motion shows too little to judge what is wrong with the recording")
    if not verdict.is_refuted:
        raise RecordingError(f"--assume {cause}: nothing is wrong with the recording that it shows; leave --assume out")
    if verdict.cause != cause:
        possible = "" if cause in MENDABLE else f"; it can be any of: {', '.join(MENDABLE)}"
        raise RecordingError(f"--assume {cause}: that does not explain the recording{possible}. {verdict.words}")
    return verdict


def with_hidden(found: Identification, verdict: Verdict) -> Identification:
    """With what each of the ten numbers may be off by the worst of causes that the recording would not have shown."""
    centre = centre_of(found.team.poses)
    _, derivative = at_first_grasp(found.payload.inertia.carried(centre.inverse()), centre)
    worst = [HiddenError("", 0.0)] * len(derivative)
    for cause, covariance in verdict.hidden:
        variances = np.diag(derivative @ covariance @ derivative.T)
        for number, variance in enumerate(variances):
            std = float(np.sqrt(max(variance, 0.0)))
            if std > worst[number].std:
                worst[number] = HiddenError(cause.value, std)
    return replace(found, hidden=tuple(worst), remarks=(*found.remarks, _what_is_hidden(worst)))


def _what_is_hidden(hidden: Sequence[HiddenError]) -> str:
    """The worst of them, in words."""
    mass, com, tensor = hidden[0], max(hidden[1:4], key=_std), max(hidden[4:], key=_std)
    return (
        f"This recording would not show sensors that are off by little, which may add standard deviations of "
        f"{mass.std:.2g} kg ({mass.cause}) to the mass, {1e3 * com.std:.2g} mm ({com.cause}) to the centre of mass and "
        f"{tensor.std:.2g} kg·m² ({tensor.cause}) to moments of inertia."
    )


def _std(error: HiddenError) -> float:
    return error.std
