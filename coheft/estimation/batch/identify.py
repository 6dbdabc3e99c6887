"""Identification from recorded twists: by least squares as in the paper, and with instrumental variables."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coheft.estimation.batch.holds import both_holds, holds_of, holds_of_means, static_estimate
from coheft.estimation.batch.identification import Identification, unsettled
from coheft.estimation.batch.inertia_fit import LinearFit, bias_of_tensor, fit_parameters, fit_tensor
from coheft.estimation.batch.pairs import (
    TeamPoses,
    derivative_by_poses,
    expected_bias,
    grasps_from_twists,
    unseen_covariance,
)
from coheft.estimation.batch.payload import hidden_covariance, make_payload, of_central_numbers
from coheft.estimation.batch.plausibility import plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, PAPER_CUTOFF, Signals, body_motions, centre_of, total_wrench
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.derivatives import central_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia

_COM_STEP = 1e-4
"""For differences [m]."""
_BIASED = 2.0
"""Bias of plain least squares that is worth a remark, in standard deviations."""


def identify_batch(
    recording: Recording, cutoff: float = PAPER_CUTOFF, statics: Recording | None = None
) -> Identification:
    """Identify by sequential least squares (Zhang et al., sec. III), with means in other holds besides."""
    signals = plausible_signals(recording, cutoff)
    team, loops = grasps_from_twists(signals, with_instruments=False)
    holds = holds_of(recording, cutoff)
    if statics is not None:
        holds = both_holds(holds, holds_of_means(statics))
    motions = body_motions(signals, team.poses)
    static, spread = static_estimate(holds, team.poses)

    def fit_at(com: Array, poses: Sequence[Pose]) -> LinearFit:
        return fit_tensor(motions[0], total_wrench(signals.wrench, poses), com, signals.rate)

    def solve(poses: Sequence[Pose]) -> Array:
        found, _ = static_estimate(holds, poses)
        return np.concatenate([found, fit_at(found[1:], poses).solution])

    tensor = fit_at(static[1:], team.poses)
    by_static = np.eye(10, 4)
    for axis, step in enumerate(_COM_STEP * np.eye(3)):
        ahead, behind = (fit_at(com, team.poses).solution for com in (static[1:] + step, static[1:] - step))
        by_static[4:, 1 + axis] = (ahead - behind) / (2.0 * _COM_STEP)
    by_poses = derivative_by_poses(solve, team.poses)
    covariance = by_static @ spread @ by_static.T + by_poses @ team.covariance @ by_poses.T
    covariance += unseen_covariance(solve, team)
    of_noise, of_tensor = bias_of_tensor(
        motions, total_wrench(signals.wrench, team.poses), static[1:], signals.rate, tensor.solution
    )
    covariance[4:, 4:] += of_tensor + hidden_covariance(tensor.hidden, static[0])
    remarks: tuple[str, ...] = ()
    if team.is_observable:
        by_grasps = expected_bias(signals, team)
        bias = by_poses @ by_grasps
        bias[4:] += of_noise
        ratio = float(np.max(np.abs(bias) / np.sqrt(np.diag(covariance))))
        if ratio >= _BIASED:
            remarks = (f"Its bias is up to {ratio:.1f} times the errors by noise; the standard deviations include it.",)
        covariance += np.outer(bias, bias)
        team = replace(team, covariance=team.covariance + np.outer(by_grasps, by_grasps))
    return Identification(
        method="batch",
        names=recording.names,
        team=team,
        payload=make_payload(of_central_numbers(np.concatenate([static, tensor.solution])), covariance, team.seen),
        loops=tuple(loops),
        holds=holds,
        remarks=(
            "Least squares takes noise of accelerations for motion: inertias come out too small, by an unknown amount. "
            "Compare with --method instruments.",
            *remarks,
        ),
        suspicions=unsettled(team),
        time=signals.time,
        residual=tensor.residual,
    )


def identify_with_instruments(recording: Recording, cutoff: float = CUTOFF) -> Identification:
    """Identify from twists as in the paper, but with instruments; mass and centre of mass from motion."""
    signals = plausible_signals(recording, cutoff)
    team, loops = grasps_from_twists(signals, with_instruments=True)
    found = identify_at_grasps("instruments", recording, signals, team)
    return replace(found, loops=tuple(loops), suspicions=unsettled(team))


def identify_at_grasps(method: str, recording: Recording, signals: Signals, team: TeamPoses) -> Identification:
    """Identify the load from motion and gravity, with these grasp poses and their uncertainty."""
    numbers, covariance, fit = parameters_fit(signals, team.poses)

    def solve(poses: Sequence[Pose]) -> Array:
        return parameters_fit(signals, poses, fit.weight)[0]

    by_poses = derivative_by_poses(solve, team.poses)
    covariance = covariance + by_poses @ team.covariance @ by_poses.T + unseen_covariance(solve, team)
    return Identification(
        method=method,
        names=recording.names,
        team=team,
        payload=make_payload(of_central_numbers(numbers), covariance, team.seen),
        time=signals.time,
        residual=fit.residual,
    )


def parameters_fit(
    signals: Signals, poses: Sequence[Pose], weight: Array | None = None
) -> tuple[Array, Array, LinearFit]:
    """Fit all ten parameters from motion and gravity, each robot with the others as instruments.

    Returns:
        ``(m, h, J)`` in the first robot's frame, shape (10,), their covariance without the uncertainty of the poses,
        shape (10, 10), and the fit about the middle of the grasps.
    """
    centre = centre_of(poses)
    from_centre = [centre.inverse() @ pose for pose in poses]
    total = total_wrench(signals.wrench, from_centre)
    fit = fit_parameters(body_motions(signals, from_centre), total, signals.rate, weight)
    about_centre = Inertia.from_barycentric(fit.solution)
    derivative = central_derivative(about_centre)
    covariance = fit.covariance + hidden_covariance(fit.hidden, float(fit.solution[0]))
    return about_centre.transported(centre).central(), derivative @ covariance @ derivative.T, fit
