"""Finding a load in a recording, for programs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy.typing as npt

from coheft.app.identify.choices import Bounds, Method, Options
from coheft.app.identify.evaluate import ARRAYS, evaluate
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
    """Find out from a recording where the robots held the load, and its mass, centre of mass and inertia.

    Args:
        recording: Path of what ``coheft identify`` reads, or arrays by the names that an ``.npz`` file has for them:
            ``left/t``, ``left/wrench``, ``left/pose``, … of each robot, see docs/data-format.md for shapes and units.
        method: ``batch``, ``instruments``, ``pose``, ``likelihood`` or ``static``; without it, what suits best.
        calibrate: The robots are not well calibrated; estimate what is wrong with them as well (method ``pose``).
        bounds: With ``calibrate``: how wrong they may be.
        from_: Leave out what was before [s].
        to: Leave out what came after [s].
        cutoff: Of the low-pass filter [Hz].
        topics: Of an MCAP file or a bag: which are of which robot, ``ROBOT=TOPIC`` each.
        holds: Recording of the same load, held still in some orientations by the same robots.
        assume: What is wrong with the recording, by the name that its verdict has: it is taken out.

    Returns:
        What ``coheft identify --json`` writes; ``doubts`` and ``not_observable`` say what is not to be trusted.

    Raises:
        RecordingError: It cannot be read, or cannot be a recording of one load; says what, and why.
        UsageError: Arguments contradict each other; it names options of the command, which are called alike.
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
