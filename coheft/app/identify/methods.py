"""Which method suits a recording, and how each is called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from coheft.errors import RecordingError
from coheft.estimation.batch.calibration import Tolerances
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.identify import identify_batch, identify_with_instruments
from coheft.estimation.batch.identify_poses import identify_poses
from coheft.estimation.batch.identify_sensors import identify_sensors
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import CUTOFF, PAPER_CUTOFF

Method = Literal["batch", "instruments", "pose", "likelihood"]


@dataclass(frozen=True)
class Bounds:
    """How wrong robots may be that are not calibrated: errors are anywhere within plus or minus these.

    Attributes:
        misalignment_deg: Zero of the gimbal, about any axis [degrees].
        angle_scale: Of each gimbal angle, relative.
        position_scale: Of the position, relative.
        force_scale: Of the force, relative.
        force_offset: Of each axis of the force [N].
    """

    misalignment_deg: float = 1.0
    angle_scale: float = 0.01
    position_scale: float = 0.03
    force_scale: float = 0.01
    force_offset: float = 0.5

    def tolerances(self) -> Tolerances:
        """As standard deviations."""
        return Tolerances.of_bounds(
            self.misalignment_deg, self.angle_scale, self.position_scale, self.force_scale, self.force_offset
        )


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
        return identify_poses(recording, None if bounds is None else bounds.tolerances(), cutoff or CUTOFF)
    return identify_sensors(recording)
