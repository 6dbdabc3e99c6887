"""Identification of a load from a recording."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Method, Options
from coheft.app.identify.methods import ARRAYS, evaluate
from coheft.app.identify.report import IdentifyReport, make_report


def identify(
    recording: str | Path | Mapping[str, npt.ArrayLike],
    *,
    method: Method | None = None,
    calibrate: bool = False,
    bounds: Bounds | None = None,
    from_: float | None = None,
    to: float | None = None,
    cutoff: float | None = None,
    topics: Sequence[str] = (),
    holds: str | Path | None = None,
    assume: str | None = None,
) -> IdentifyReport:
    """Identify a load from a recording: where the robots held it, its mass, centre of mass and inertia.

    Args:
        recording: Path of a recording that ``coheft identify`` reads, or arrays named as in an ``.npz`` file:
            ``left/t``, ``left/wrench``, ``left/pose``, … for each robot; docs/data-format.md has shapes and units.
            Wrenches have the moment first, unlike the samples of ``coheft.estimators``.
        method: ``batch``, ``instruments``, ``pose``, ``likelihood`` or ``static``; by default the best one that the
            recording allows.
        calibrate: Estimate calibration errors of the robots as well (method ``pose``).
        bounds: With ``calibrate``: bounds of the calibration errors.
        from_: Ignore everything before this time [s].
        to: Ignore everything after this time [s].
        cutoff: Cutoff of the low-pass filter [Hz].
        topics: Topics of each robot in an MCAP file or a bag, as ``ROBOT=TOPIC``.
        holds: Recording of the same load held still in several orientations by the same robots.
        assume: Correct the recording for this fault first, named as in the report's verdict.

    Returns:
        The report that ``coheft identify --json`` writes; ``doubts`` and ``not_observable`` describe what to distrust.

    Raises:
        RecordingError: The recording cannot be read, or cannot be of one load; the message says why.
        UsageError: Arguments contradict each other; the message names the options of the command, which have the same
            names.
    """
    options = Options(
        method=method,
        calibrate=calibrate,
        bounds=bounds,
        from_=from_,
        to=to,
        cutoff=cutoff,
        topics=tuple(topics),
        holds=None if holds is None else Path(holds),
        assume=assume,
    )
    if isinstance(recording, Mapping):
        return make_report(ARRAYS, *evaluate(recording, options))
    return make_report(str(recording), *evaluate(Path(recording), options))
