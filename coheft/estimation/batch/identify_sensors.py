"""From a recording of gyros, velocities and accelerometers of known noise to the load: maximum likelihood."""

from __future__ import annotations

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.doubts import unsettled
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.payload import Payload
from coheft.estimation.batch.plausibility import check_units, check_weight
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.centralised import estimate_centralised
from coheft.estimation.rigid_body import Inertia

_TOO_LARGE = 1.3
"""Residuals are suspicious from this share of what noise explains on."""

_SUSPECTS = ": did the load change (--from and --to choose a part), or are the sensors worse than 'noise' says?"


def identify_sensors(recording: Recording) -> Identification:
    """What a central computer finds with the noise that the recording names (``coheft.estimation.centralised``).

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
    found = estimate_centralised(samples, recording.noise, recording.rate)
    estimate = found.payload
    size = float(np.sqrt(np.mean(np.square(found.residual) / np.diag(found.expected))))
    remark = f"Residuals of the total wrench are {size:.2f} times as large as the sensors' noise explains"
    remark += _SUSPECTS if size > _TOO_LARGE else "."
    return Identification(
        method="likelihood",
        names=recording.names,
        team=found.team,
        payload=Payload(
            inertia=estimate.inertia,
            measured=Inertia.from_barycentric(estimate.parameters),
            covariance=found.covariance,
            unseen=estimate.unseen,
        ),
        remarks=(remark,),
        suspicions=unsettled(found.team, found.is_settled),
        time=recording.time[found.rows],
        residual=found.residual,
    )
