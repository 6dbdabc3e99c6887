"""Identification from recorded twists: by least squares as in the paper, and with instrumental variables.

By maximum likelihood, too, from gyros, velocities and accelerometers with known noise.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.holds import Holds, holds_of, holds_of_means, static_estimate
from coheft.estimation.batch.identification import Identification, unsettled
from coheft.estimation.batch.inertia_fit import LinearFit, bias_of_tensor, fit_parameters, fit_tensor
from coheft.estimation.batch.judge.band import HIGHEST, white_level
from coheft.estimation.batch.pairs import (
    TeamPoses,
    derivative_by_poses,
    expected_bias,
    grasps_from_twists,
    unseen_covariance,
)
from coheft.estimation.batch.payload import Payload, hidden_covariance, make_payload, of_central_numbers
from coheft.estimation.batch.plausibility import check_plausible, check_weight, plausible_signals
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, PAPER_CUTOFF, Signals, body_motions, centre_of, total_wrench
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.claims import possible_load
from coheft.estimation.moments.recorded import fit_recorded
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.rigid_body.derivatives import central_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unobservable import unobservable_quantities

_COM_STEP = 1e-4
"""For differences [m]."""
_BIASED = 2.0
"""Bias of plain least squares that is worth a remark, in standard deviations."""
_MOST = 1.3
"""Largest factor between residuals, or the noise of samples, and the noise that the recording names."""
_SUITABLE = 1.12
"""Largest one with which no other method suits better."""
_HIDDEN = 1e6
"""Stands for an infinite variance of directions of poses that are not observable."""
_SUSPECTS = (
    ": did the load change (--from and --to choose a part), or are the sensors worse than 'noise' says? "
    "This method estimates no scales, offsets or mountings of sensors; --method instruments asks for no noise."
)
_TOO_LARGE = ": give the standard deviations of single samples, or use --method instruments, which asks for no noise."


def identify_batch(
    recording: Recording, cutoff: float = PAPER_CUTOFF, statics: Recording | None = None
) -> Identification:
    """Identify by sequential least squares (Zhang et al., sec. III), with means in other holds besides."""
    signals = plausible_signals(recording, cutoff)
    team, loops = grasps_from_twists(signals, with_instruments=False)
    holds = holds_of(recording, cutoff)
    if statics is not None:
        more = holds_of_means(statics)
        pairs = ((holds.down, more.down), (holds.wrench, more.wrench), (holds.scatter, more.scatter))
        holds = Holds(holds.spans, *map(np.concatenate, pairs))
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


def identify_sensors(recording: Recording) -> Identification:
    """Fit all rows of a recording of twists, accelerations and wrenches with the noise that it names."""
    check_plausible(recording)
    if recording.noise is None:
        raise RecordingError(
            "'noise' is missing, by which --method likelihood weighs sensors: add it, five standard deviations in an "
            ".npz file, or choose another method"
        )
    channels = [recording.stacked(channel) for channel in ("twist", "acceleration", "wrench")]
    check_weight(recording, channels[2], channels[1])
    samples = np.concatenate(channels, axis=-1).swapaxes(0, 1)
    found = fit_recorded(samples, recording.noise, recording.rate)
    estimate = found.estimate
    state, places, inertia = estimate.state, estimate.body.unknowns, possible_load(estimate)
    assert state.load is not None  # it has been fitted
    poses = np.ix_(places.poses.ravel(), places.poses.ravel())
    team = TeamPoses(state.poses, estimate.seen[poses] + _HIDDEN * estimate.hidden[poses], found.is_settled)
    to_central = central_derivative(inertia)
    covariance = to_central @ estimate.covariance[places.theta, places.theta] @ to_central.T
    size = float(np.sqrt(np.mean(np.square(found.residual) / np.diag(found.expected))))
    covariance *= max(1.0, size) ** 2
    ratio, suspects = size, _SUSPECTS
    words = f"Residuals of the total wrench are {size:.2f} times as large as the sensors' noise explains"
    for sensor, shown in _noise_shown(samples, recording.noise, recording.rate):
        if max(shown, 1.0 / shown) > max(ratio, _SUITABLE):
            ratio, suspects = max(shown, 1.0 / shown), _SUSPECTS if shown > 1.0 else _TOO_LARGE
            words = f"Samples of {sensor} show {shown:.2g} times the noise that 'noise' of the recording names"
    is_refuted = ratio > _MOST
    remark = words + (suspects if is_refuted else ".")
    return Identification(
        method="likelihood",
        names=recording.names,
        team=team,
        payload=Payload(
            inertia=inertia,
            measured=Inertia.from_barycentric(state.load[THETA]),
            covariance=covariance,
            unobservable=unobservable_quantities(covariance, inertia.mass, estimate.guess.size),
        ),
        remarks=() if is_refuted else (remark,),
        suspicions=((remark,) if is_refuted else ()) + unsettled(team),
        time=recording.time[: len(found.residual) * found.row_samples].reshape(-1, found.row_samples).mean(axis=1),
        residual=found.residual,
        unsuitable=words if ratio > _SUITABLE else "",
    )


def _noise_shown(samples: Array, noise: SensorNoise, rate: float) -> Iterator[tuple[str, float]]:
    """Yield each kind of sensor and its noise, geometric mean over axes and robots, in multiples of what is named.

    There is nothing if there are too few samples (n, N, 15) to tell. Forces and moments are never called noisier:
    robots may shake against each other, which cancels in their sum.
    """
    level = white_level(samples.reshape(len(samples), -1), rate, HIGHEST * rate)
    if level is None:
        return
    by_kind = level.reshape(-1, 5, 3).swapaxes(0, 1).reshape(5, -1)
    for sensor, own in zip(noise.__struct_fields__, by_kind, strict=True):
        if own.all():
            shown = float(np.exp(np.mean(np.log(own)))) / getattr(noise, sensor)
            yield sensor, min(shown, 1.0) if sensor in ("force", "torque") else shown
