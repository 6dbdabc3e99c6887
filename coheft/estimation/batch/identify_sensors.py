"""From a recording of gyros, velocities and accelerometers of known noise to the load: maximum likelihood."""

from __future__ import annotations

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.doubts import unsettled
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.plausibility import check_units, check_weight
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.batch.team_poses import TeamPoses
from coheft.estimation.geometry.observability import Visibility
from coheft.estimation.moments.claims import possible_load
from coheft.estimation.moments.recorded import fit_recorded
from coheft.estimation.moments.unknowns import THETA
from coheft.estimation.rigid_body.derivatives import central_derivative
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.estimation.rigid_body.unseen import unseen_quantities

_TOO_LARGE = 1.3
"""Residuals are suspicious from this share of what noise explains on,"""
_FAR_TOO_LARGE = 3.0
"""and no number is to be trusted from this one on: no sensor's noise is known so badly."""

_HIDDEN = 1e6
"""What is not seen of poses has so many times the variance that a fit lets it have: a stand-in for infinity."""
_SUSPECTS = (
    ": did the load change (--from and --to choose a part), or are the sensors worse than 'noise' says? "
    "This method estimates no scales, offsets or mountings of sensors."
)


def identify_sensors(recording: Recording) -> Identification:
    """What a central computer finds with the noise that the recording names (``coheft.estimation.moments.recorded``).

    Args:
        recording: With twists, accelerations, wrenches, and noise.

    Raises:
        RecordingError: Something is missing.
    """
    check_recording(recording)
    if recording.noise is None:
        raise RecordingError(
            "'noise' is missing, by which --method likelihood weighs sensors: add it, five standard deviations in an "
            ".npz file, or choose another method"
        )
    channels = [recording.stacked(channel) for channel in ("twist", "acceleration", "wrench")]
    check_units(recording)
    check_weight(recording, channels[2], channels[1])
    samples = np.concatenate(channels, axis=-1).swapaxes(0, 1)
    found = fit_recorded(samples, recording.noise, recording.rate)
    estimate = found.estimate
    state, places, inertia = estimate.state, estimate.body.unknowns, possible_load(estimate)
    assert state.load is not None  # it has been fitted
    poses = np.ix_(places.poses.ravel(), places.poses.ravel())
    team = TeamPoses(state.poses, estimate.seen[poses] + _HIDDEN * estimate.hidden[poses], Visibility())
    to_central = central_derivative(inertia)
    covariance = to_central @ estimate.covariance[places.theta, places.theta] @ to_central.T
    size = float(np.sqrt(np.mean(np.square(found.residual) / np.diag(found.expected))))
    remark = f"Residuals of the total wrench are {size:.2f} times as large as the sensors' noise explains"
    remark += _SUSPECTS if size > _TOO_LARGE else "."
    is_refuted = size > _FAR_TOO_LARGE
    return Identification(
        method="likelihood",
        names=recording.names,
        team=team,
        payload=Payload(
            inertia=inertia,
            measured=Inertia.from_barycentric(state.load[THETA]),
            covariance=covariance,
            unseen=unseen_quantities(covariance, inertia.mass, estimate.size),
        ),
        remarks=() if is_refuted else (remark,),
        suspicions=((remark,) if is_refuted else ()) + unsettled(team, found.is_settled),
        time=recording.time[: len(found.residual) * found.row_samples].reshape(-1, found.row_samples).mean(axis=1),
        residual=found.residual,
    )
