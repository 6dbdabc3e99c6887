"""Whether samples have the noise that a recording names."""

from collections.abc import Iterator

import numpy as np

from coheft.estimation.batch.judge.band import HIGHEST, white_level
from coheft.estimation.batch.recording import Recording

_SENSORS = (
    ("gyro", "twist", slice(0, 3)),
    ("velocity", "twist", slice(3, 6)),
    ("acceleration", "acceleration", slice(0, 3)),
    ("force", "wrench", slice(0, 3)),
    ("torque", "wrench", slice(3, 6)),
)
"""Names in ``SensorNoise``, channels, and their columns."""


def noise_shown(recording: Recording) -> Iterator[tuple[str, float]]:
    """Yield each kind of sensor and its noise, geometric mean over axes and robots, in multiples of what is named.

    There is nothing if there are too few samples to tell, or if the recording names no noise. Forces and moments are
    never called noisier: robots may shake against each other, which cancels in their sum.
    """
    if recording.noise is None:
        return
    for sensor, channel, columns in _SENSORS:
        samples = np.hstack(list(recording.stacked(channel)[..., columns]))
        level = white_level(samples, recording.rate, HIGHEST * recording.rate)
        if level is not None and level.all():
            shown = float(np.exp(np.mean(np.log(level)))) / getattr(recording.noise, sensor)
            yield sensor, min(shown, 1.0) if channel == "wrench" else shown
