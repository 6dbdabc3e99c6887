"""Identification of grasps, mass and centre of mass from a load that is held still in several orientations."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.errors import RecordingError
from coheft.estimation.batch.hand_eye import fit_hand_eye
from coheft.estimation.batch.holds import Holds, holds_of_means, orientations, static_estimate
from coheft.estimation.batch.identification import Identification, unsettled
from coheft.estimation.batch.pairs import TeamPoses, derivative_by_poses, kabsch
from coheft.estimation.batch.payload import hidden_covariance, make_payload, of_central_numbers
from coheft.estimation.batch.plausibility import check_weight
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import total_wrench
from coheft.estimation.batch.wrist_poses import WristPoses
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.linear_algebra import positive_part

_FEWEST = 3
"""Least number of holds that determine grasps."""
_KNOWN = 4
"""Number of parameters that holds determine: mass and centre of mass."""
_ASIDE = 0.05
"""Largest total force across gravity, as a share of the weight."""
_ROUNDING = 1e-12
"""Share of variances that is rounding."""
_APART = 7.0
"""Standard deviations by which holds and motion may differ; the deviations from few holds are uncertain."""


def identify_statics(statics: Recording) -> Identification:
    """Identify grasps, mass and centre of mass from means in holds; the inertia is not observable."""
    count = len(statics.time)
    if count < _FEWEST:
        raise RecordingError(
            f"found {count} holds, expected at least {_FEWEST}: where robots hold the load follows from how their "
            f"poses change between orientations of it"
        )
    holds, measured = holds_of_means(statics), statics.stacked("pose")
    check_weight(statics, statics.stacked("wrench"), -holds.down.swapaxes(0, 1))
    starts = [Pose.identity(), *(_grasp(measured[0], pose) for pose in measured[1:])]
    grasps = fit_hand_eye(WristPoses.of(measured, 1.0, at_home=False), starts, is_independent=True)
    team = grasps.team
    if not team.is_observable:
        raise RecordingError(
            f"found {orientations(holds.down[:, 0])} orientations in {count} holds: they do not show where robots hold "
            f"the load; expected orientations that differ by turns about two axes at least, far apart"
        )
    found, covariance = _estimate(holds, team.poses)
    numbers = np.concatenate([found, found[0] * np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])])
    whole = hidden_covariance(np.eye(10)[:, _KNOWN:], numbers[0])
    whole[:_KNOWN, :_KNOWN] = covariance + _by_poses(holds, team)
    return Identification(
        method="static",
        names=statics.names,
        team=team,
        payload=make_payload(of_central_numbers(numbers), whole, team.poses),
        remarks=(f"The load was held still: {_held(holds)}.",),
        not_judged="a load that is held still shows too little of what may be wrong with sensors",
        suspicions=(*_not_along(holds, team.poses), *unsettled(team)),
        time=np.arange(count, dtype=np.float64),
        residual=_residual(holds, team.poses, found),
    )


def with_statics(found: Identification, statics: Recording) -> Identification:
    """Combine an identification from motion with means in holds that were recorded separately.

    Errors of the grasp poses affect both equally, so that the combination does not reduce them.
    """
    team, holds = found.team, holds_of_means(statics)
    if not team.is_observable:
        remark = "Holds that were recorded apart are not used: the motion does not show where robots hold the load."
        return replace(found, remarks=(*found.remarks, remark))
    still, spread = _estimate(holds, team.poses)
    shared = _by_poses(holds, team)
    numbers, covariance = found.payload.measured.central(), found.payload.covariance
    own = positive_part(covariance[:_KNOWN, :_KNOWN] - shared)
    difference = still - numbers[:_KNOWN]
    innovation = own + spread + _ROUNDING * np.diag(np.diag(covariance)[:_KNOWN])
    gain = covariance[:, :_KNOWN].copy()
    gain[:_KNOWN] = own
    gain = gain @ np.linalg.inv(innovation)
    numbers = numbers + gain @ difference
    whole = positive_part(covariance - gain @ innovation @ gain.T)
    apart = float(np.sqrt(difference @ np.linalg.solve(innovation, difference)))
    suspicion = (
        f"Held still the load weighs {still[0]:.4g} kg with its centre at "
        f"({', '.join(f'{x:.4f}' for x in still[1:])}) m, {apart:.0f} standard deviations from what it is in motion: "
        f"is it the same load, held in the same way, and have sensors been tared the same way?"
    )
    return replace(
        found,
        payload=make_payload(of_central_numbers(numbers), whole, team.poses),
        remarks=(*found.remarks, f"Apart from the motion, the load was held still: {_held(holds)}."),
        suspicions=(*found.suspicions, *((suspicion,) if apart > _APART else ()), *_not_along(holds, team.poses)),
    )


def _grasp(first: Array, other: Array) -> Pose:
    """Rough pose of one grasp frame in another from poses (H, 7) of both, by ``A X = X B`` between any two holds."""
    turns, shifts = zip(*(_changes(poses) for poses in (first, other)), strict=True)
    rotation = kabsch(turns[0].as_rotvec(), turns[1].as_rotvec())
    matrix = (turns[0].as_matrix() - np.eye(3)).reshape(-1, 3)
    position = np.linalg.lstsq(matrix, (shifts[1] @ rotation.T - shifts[0]).ravel(), rcond=1e-3)[0]
    return Pose(rotation, position.astype(np.float64))


def _changes(poses: Array) -> tuple[Rotation, Array]:
    """Rotations and translations between any two of the poses (H, 7) of a grasp frame, in the axes of the former."""
    before, after = np.triu_indices(len(poses), 1)
    rotations = Rotation.from_quat(poses[:, 3:])
    start = rotations[before].inv()
    return start * rotations[after], start.apply(poses[after, :3] - poses[before, :3])


def _estimate(holds: Holds, poses: Sequence[Pose]) -> tuple[Array, Array]:
    """``(m, h)`` (4,), and their covariance (4, 4), which allows for the uncertain size of the noise of few holds."""
    numbers, covariance = static_estimate(holds, poses)
    residual, count = _residual(holds, poses, numbers), len(holds.down)
    of_force, of_torque = 3 * count - 1, 3 * count - 3
    strength = float(np.linalg.norm(holds.down[0, 0]))
    force = float(np.square(residual[:, :3]).sum()) / of_force / count / strength**2
    # Variances of Student's t.
    covariance[0, 0] = max(covariance[0, 0], force * of_force / (of_force - 2.0))
    covariance[1:, 1:] *= of_torque / (of_torque - 2.0)
    return numbers, covariance


def _by_poses(holds: Holds, team: TeamPoses) -> Array:
    """Covariance (4, 4) of ``(m, h)`` due to uncertain poses."""
    derivative = derivative_by_poses(lambda poses: _estimate(holds, poses)[0], team.poses)
    return derivative @ team.covariance @ derivative.T


def _residual(holds: Holds, poses: Sequence[Pose], numbers: Array) -> Array:
    """Residual of the total wrench at rest for ``(m, h)``, shape (H, 6)."""
    weight = -numbers[0] * holds.down[:, 0]
    result: Array = total_wrench(holds.wrench.swapaxes(0, 1), poses) - np.hstack(
        [weight, np.cross(numbers[1:], weight)]
    )
    return result


def _not_along(holds: Holds, poses: Sequence[Pose]) -> tuple[str, ...]:
    """Say if the forces at rest do not add up to a weight."""
    force, down = total_wrench(holds.wrench.swapaxes(0, 1), poses)[:, :3], holds.down[:, 0]
    direction = down / np.linalg.norm(down, axis=1, keepdims=True)
    along = np.einsum("ha,ha->h", force, direction)
    aside = float(np.sqrt(np.mean(np.square(force - along[:, None] * direction).sum(axis=1))))
    if aside <= _ASIDE * abs(float(along.mean())):
        return ()
    return (
        f"At rest forces add up to {abs(float(along.mean())):.3g} N along gravity, but also to {aside:.3g} N across "
        f"it: are they in the axes of the grasp frames, sensors tared, and home frames level?",
    )


def _held(holds: Holds) -> str:
    down = holds.down[:, 0]
    return f"{len(down)} holds in {orientations(down)} orientations"
