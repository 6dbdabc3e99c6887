"""Identification with a verdict on the recording, and with the effects of faults that it would not show."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from operator import attrgetter

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.identification import HiddenError, Identification, solid_density
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.forces import judge_forces
from coheft.estimation.batch.judge.mend import MENDABLE, mend
from coheft.estimation.batch.judge.motions import judge_gravity, judge_motions
from coheft.estimation.batch.judge.poses import judge_poses
from coheft.estimation.batch.judge.sensors import spiking_sensor, stuck_motion, stuck_sensor
from coheft.estimation.batch.judge.turning import judge_turning
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.judge.words import KGF, LBF
from coheft.estimation.batch.payload import Payload, make_payload
from coheft.estimation.batch.plausibility import inverse_poses
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import centre_of
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.derivatives import central_derivative

_MENDINGS = 3
"""Number of corrections: a clock that is far off is corrected first, then by poses, then by forces that of wrenches."""
_SURELY = 3.0
"""Standard deviations."""
_STD = attrgetter("std")
_UNOBSERVABLE = "motion and gravity do not show where all robots hold the load, or that it has a weight"


def judged(
    recording: Recording, fit: Callable[[Recording], Identification], cutoff: float, assume: str | None = None
) -> Identification:
    """Identify with any method, and judge the recording.

    ``assume`` is a fault, named as in verdicts, for which the recording is corrected first; it has to explain it.
    """
    found = _judged_once(recording, fit, cutoff, assume)
    if assume is None:
        return found
    words: list[str] = []
    mended: list[Verdict] = []
    verdict = _checked(found.verdict, assume)
    for _ in range(_MENDINGS):
        assert found.evidence is not None  # there is a verdict
        words.append(f"Corrected, as assumed ({assume}): {verdict.words}")
        recording = mend(recording, verdict, found.evidence.poses)
        mended.append(verdict)
        found = _judged_once(recording, fit, cutoff, assume, mended)
        if found.verdict is None or found.verdict.cause != assume:
            break
        verdict = found.verdict
    return replace(found, remarks=(*words, *found.remarks))


def _judged_once(
    recording: Recording,
    fit: Callable[[Recording], Identification],
    cutoff: float,
    assume: str | None,
    mended: Sequence[Verdict] = (),
) -> Identification:
    found = fit(recording)
    try:
        evidence = found.evidence or Evidence.of(recording, cutoff)
        if not evidence.is_seen and stuck_motion(recording) is None:
            late = judge_turning(evidence)
            if late is None:
                return replace(found, not_judged=_UNOBSERVABLE)
            verdict = late
        else:
            verdict = _judge(evidence, assume, mended)
        if verdict.cause == Cause.UNKNOWN and recording.has("pose"):
            verdict = _inverse(recording, cutoff) or verdict
    except (ValueError, RecordingError) as error:
        return replace(found, not_judged=str(error))
    found = replace(found, verdict=verdict, evidence=evidence)
    if not verdict.is_refuted:
        return _with_hidden(_with_corrections(found, verdict), verdict)
    return replace(found, suspicions=tuple(one for one in found.suspicions if one != verdict.words))


def _judge(evidence: Evidence, assumed: str | None = None, mended: Sequence[Verdict] = ()) -> Verdict:
    """Judge sensors, poses, motions and, if poses are those of one load, forces."""
    recording = evidence.recording
    fault = (
        stuck_motion(recording)
        or stuck_sensor(recording)
        or spiking_sensor(recording)
        or judge_turning(evidence)
        or judge_poses(evidence)
        or judge_motions(evidence)
        or judge_gravity(evidence)
    )
    if fault is not None:
        return fault
    if evidence.suspicions:
        return Verdict(cause=Cause.UNKNOWN, words=evidence.suspicions[0])
    return judge_forces(evidence, assumed, mended)


def _inverse(recording: Recording, cutoff: float) -> Verdict | None:
    """Find out whether all poses are inverse: then they fit each other, but not the forces."""
    try:
        verdict = _judge(Evidence.of(recording.changed("pose", inverse_poses), cutoff))
    except RecordingError:
        return None
    if verdict.is_refuted:
        return None
    words = (
        "forces do not fit these poses, but they fit their inverses: all poses seem to be those of the home frame in "
        "the grasp frame, and not the other way round: invert them"
    )
    return Verdict(Cause.INVERSE, words=words)


def _checked(verdict: Verdict | None, cause: str) -> Verdict:
    """Return the verdict if its fault is the one that the user names."""
    if verdict is None:
        raise RecordingError(f"--assume {cause}: the motion shows too little to judge what is wrong with the recording")
    if not verdict.is_refuted:
        raise RecordingError(f"--assume {cause}: nothing is wrong with the recording that it shows; leave --assume out")
    if verdict.cause != cause:
        possible = "" if cause in MENDABLE else f"; it can be any of: {', '.join(MENDABLE)}"
        raise RecordingError(f"--assume {cause}: that does not explain the recording{possible}. {verdict.words}")
    if verdict.is_open:
        unclear = "nothing says whose readings to correct, or how, so do it"
        raise RecordingError(f"--assume {cause}: {unclear}. {verdict.words}")
    return verdict


def _by_theta(found: Identification) -> Array:
    """Derivative (10, 10) of ``(m, h, J)`` by ``theta`` in the body frame."""
    return central_derivative(found.payload.inertia.transported(centre_of(found.team.poses).inverse()))


def _with_corrections(found: Identification, verdict: Verdict) -> Identification:
    """Add the uncertainty of the corrections that were made."""
    if not verdict.corrections:
        return found
    derivative = _by_theta(found)
    covariance = found.payload.covariance + derivative @ sum(verdict.corrections) @ derivative.T
    return replace(found, payload=make_payload(found.payload.measured, covariance, found.team.seen))


def _with_hidden(found: Identification, verdict: Verdict) -> Identification:
    """Add, for each of the ten numbers, the effect of the worst fault that the recording would not show."""
    derivative = _by_theta(found)
    hidden = [HiddenError("", 0.0)] * len(derivative)
    for cause, covariance in verdict.hidden:
        stds = np.sqrt(np.maximum(np.diag(derivative @ covariance @ derivative.T), 0.0)).tolist()
        hidden = [max(one, HiddenError(cause, std), key=_STD) for one, std in zip(hidden, stds, strict=True)]
    remark = (verdict.remark,) if verdict.remark else ()
    remarks = (*found.remarks, *remark, _what_is_hidden(hidden), *_common_scale(found.payload))
    return replace(found, hidden=tuple(hidden), remarks=remarks)


def _what_is_hidden(hidden: Sequence[HiddenError]) -> str:
    mass, com, tensor = hidden[0], max(hidden[1:4], key=_STD), max(hidden[4:], key=_STD)
    return (
        f"Small faults of sensors that this recording would not show may add standard deviations of {mass.std:.2g} kg "
        f"({mass.cause}) to the mass, {1e3 * com.std:.2g} mm ({com.cause}) to the centre of mass and "
        f"{tensor.std:.2g} kg·m² ({tensor.cause}) to moments of inertia."
    )


def _common_scale(payload: Payload) -> tuple[str, ...]:
    """Remind of a common scale, which no recording shows, with a density by which to judge it."""
    if not (payload.is_seen("mass") and payload.is_seen("inertia")):
        return ()
    mass = payload.inertia.mass
    return (
        f"No motion shows a common factor of all forces and moments: if they are in kgf, the mass is {KGF * mass:.3g} "
        f"kg, in lbf {LBF * mass:.3g} kg. As found, a solid ellipsoid would have at least "
        f"{solid_density(payload, _SURELY):,.0f} kg/m³.",
    )
