"""Which method suits a recording, and how each is called."""

from __future__ import annotations

from coheft.app.identify.choices import Bounds, Method
from coheft.errors import RecordingError
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.identify import identify_batch, identify_with_instruments
from coheft.estimation.batch.identify_poses import identify_poses
from coheft.estimation.batch.identify_sensors import identify_sensors
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, PAPER_CUTOFF


def suitable(recording: Recording) -> Method:
    """The best method for what was recorded."""
    if recording.has("pose"):
        return "pose"
    if recording.has("acceleration") and recording.has("twist") and recording.noise is not None:
        return "likelihood"
    return "instruments"


def identify(
    recording: Recording, method: Method | None = None, bounds: Bounds | None = None, cutoff: float | None = None
) -> Identification:
    """Identify the load.

    Args:
        recording: What was recorded.
        method: None: what suits it.
        bounds: Of calibration errors, which are then estimated along; None: there are none.
        cutoff: Of the low-pass filter [Hz]; None: the method's own.

    Raises:
        RecordingError: The recording does not hold what the method needs, or the method cannot do it.
    """
    method = method or suitable(recording)
    if bounds is not None and method != "pose":
        raise RecordingError(f"calibration errors are estimated by --method pose only, not by {method}")
    if method == "batch":
        return identify_batch(recording, cutoff or PAPER_CUTOFF)
    if method == "instruments":
        return identify_with_instruments(recording, cutoff or CUTOFF)
    if method == "pose":
        return identify_poses(recording, None if bounds is None else _tolerances(bounds), cutoff or CUTOFF)
    if cutoff is not None:
        raise RecordingError(f"--method {method} has no filter: leave --cutoff out, or choose another method")
    return identify_sensors(recording)


def _tolerances(bounds: Bounds) -> Tolerances:
    """As standard deviations."""
    return Tolerances.of_bounds(
        bounds.misalignment_deg, bounds.angle_scale, bounds.position_scale, bounds.force_scale, bounds.force_offset
    )
