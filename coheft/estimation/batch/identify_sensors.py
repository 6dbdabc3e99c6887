"""Identification by maximum likelihood from gyros, velocities and accelerometers with known noise."""

from collections.abc import Iterator

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.identification import Identification, unsettled
from coheft.estimation.batch.judge.band import HIGHEST, white_level
from coheft.estimation.batch.pairs import TeamPoses
from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.plausibility import check_plausible, check_weight
from coheft.estimation.batch.recording import Recording
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.claims import possible_load
from coheft.estimation.moments.recorded import fit_recorded
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.rigid_body.derivatives import central_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unobservable import unobservable_quantities

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


_SENSORS = (
    ("gyro", "twist", slice(0, 3)),
    ("velocity", "twist", slice(3, 6)),
    ("acceleration", "acceleration", slice(0, 3)),
    ("force", "wrench", slice(0, 3)),
    ("torque", "wrench", slice(3, 6)),
)
"""Names in ``SensorNoise``, channels, and their columns."""


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
    for sensor, shown in _noise_shown(recording, recording.noise):
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
            unobservable=unobservable_quantities(covariance, inertia.mass, estimate.size),
        ),
        remarks=() if is_refuted else (remark,),
        suspicions=((remark,) if is_refuted else ()) + unsettled(team),
        time=recording.time[: len(found.residual) * found.row_samples].reshape(-1, found.row_samples).mean(axis=1),
        residual=found.residual,
        unsuitable=words if ratio > _SUITABLE else "",
    )


def _noise_shown(recording: Recording, noise: SensorNoise) -> Iterator[tuple[str, float]]:
    """Yield each kind of sensor and its noise, geometric mean over axes and robots, in multiples of what is named.

    There is nothing if there are too few samples to tell. Forces and moments are never called noisier: robots may shake
    against each other, which cancels in their sum.
    """
    for sensor, channel, columns in _SENSORS:
        samples = np.hstack(list(recording.stacked(channel)[..., columns]))
        level = white_level(samples, recording.rate, HIGHEST * recording.rate)
        if level is not None and level.all():
            shown = float(np.exp(np.mean(np.log(level)))) / getattr(noise, sensor)
            yield sensor, min(shown, 1.0) if channel == "wrench" else shown
