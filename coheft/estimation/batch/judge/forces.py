"""Whether one rigid body explains the forces of a recording; if not, which single fault does."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coheft.estimation.batch.judge.colour import colour_of
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.mend import MENDABLE, mend
from coheft.estimation.batch.judge.motions import gravity_factors
from coheft.estimation.batch.judge.sensors import (
    FORCES,
    MOMENTS,
    interrupted_sensor,
    missing_axis,
    saturated_sensor,
    silent_sensor,
)
from coheft.estimation.batch.judge.suspects import Suspect, Suspects, forces_instead
from coheft.estimation.batch.judge.verdict import ALL, Cause, Verdict
from coheft.estimation.batch.judge.words import angle_deg, is_ambiguous, is_likely, is_unit_of_all, words_of
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, Fit, WrenchMisfit
from coheft.estimation.batch.signals import signals_of
from coheft.estimation.geometry.spatial import Array

_EXCESS = 4.5
"""Deviations of the residuals beyond which they are no chance."""
_GAIN = 6.0
"""Gain of a fault beyond which it is no chance, see ``Suspect.gain``."""
_SHARE = 0.02
"""Share of the wrench's changes; a smaller misfit without a named fault hardly matters."""
_MENDED = 0.02
"""Share of the excess that a fault may leave if it is the only one."""
_CARRIED = 0.02
"""Share of all forces, beyond those of any body, that something else may exert."""
_LIMITED = 0.01
"""Share of the time in which a sensor is saturated that matters before other faults."""
_SLACK = 0.5
"""Added to the limit of the excess when a fault has been estimated along, in deviations."""
_LIKELY = 8
"""Number of faults besides which noise may be coloured."""
_CONFIRMED = 6
"""Number of faults that are confirmed by correcting the recording."""
_ROUGH = 0.01
"""Relative standard deviation of a factor that is known badly."""
_ALMOST = 0.05
"""Difference of a factor from minus one that calibration may explain."""
_CLOSE = 10.0
"""Faults whose gains differ by less are nearly equally likely."""
_OFF = 0.2
"""Home frames that are off by more than this share of the largest angle are not level."""
_ALIKE = 2.0
"""Largest difference in standard deviations between loads that are the same, whichever robot is corrected."""
_HIDING = (
    *(Cause.OFFSET, Cause.LEVER, Cause.SCALE, Cause.FORCE_SCALE, Cause.CLOCK, Cause.GRAVITY, Cause.LENGTH_SCALE),
)
"""Faults that sensors may well have without being noticed."""
_OF_CALIBRATION = (Cause.COMPENSATED, Cause.TIME, Cause.LENGTH_SCALE)
"""Faults that small calibration errors look like: no misfit, no fault."""
_UNCERTAIN = (
    *(Cause.OFFSET, Cause.DRIFT, Cause.LEVER, Cause.SCALE, Cause.FORCE_SCALE, Cause.MOMENT_SCALE, Cause.AXIS_SCALE),
    *(Cause.TURNED, Cause.CLOCK, Cause.LENGTH_SCALE, Cause.GRAVITY),
)
"""Faults with parameters that are estimated; the others are there, or not."""
_LEVEL, _SURE = 0.5, 6.0
"""Home frames are not level if they differ by more than this angle [degrees] and this multiple of its deviation."""


def judge_forces(evidence: Evidence, assumed: str | None, mended: Sequence[Verdict]) -> Verdict:
    """Judge whether the forces are those of one rigid body.

    ``assumed`` is the fault that the user names; the recording has been corrected for those of ``mended``.
    """
    recording, cutoff = evidence.recording, evidence.cutoff
    misfit = WrenchMisfit(evidence)
    suspects, plain = Suspects(misfit), misfit.plain
    level = _level(evidence, suspects, plain)
    if level is not None:
        return level
    found, remark = suspects.all(), ""
    likely = [(one.fit, plain.misfit - one.fit.misfit - one.gain) for one in found[:_LIKELY] if one.gain > _GAIN]
    if (plain.excess > _EXCESS or likely) and (coloured := colour_of(misfit, likely)) is not None:
        misfit = WrenchMisfit(evidence, coloured[0])
        suspects, plain = Suspects(misfit), misfit.plain
        found = suspects.all()
        remark = (
            f"Noise of wrenches is not white, but correlated over about {coloured[1]:.1g} s: standard deviations count "
            f"it in."
        )
    if assumed == Cause.FORCE_SCALE:
        found += [forces_instead(one) for one in found if is_unit_of_all(one)]
    is_misfit = plain.excess > _EXCESS
    sure = [one for one in found if one.gain > _GAIN and (is_misfit or one.cause not in _OF_CALIBRATION)]
    broken = silent_sensor(recording, cutoff, is_whole=True)  # what others exert may still be that of a lighter load
    if not sure and not (is_misfit and misfit.share() > _SHARE):
        return broken or replace(_accepted(evidence, plain, found, mended), remark=remark)
    broken = missing_axis(recording, FORCES) or saturated_sensor(recording, _LIMITED) or broken
    if broken is not None:
        return broken
    mending = [one for one in sure if _mends(one, plain.excess)]
    as_assumed = [one for one in mending if one.cause == assumed]
    confirmed = _confirmed(as_assumed or mending, evidence, suspects.homes)
    unmendable = [one for one in mending[:1] if one.cause not in MENDABLE]
    best = next(iter([*confirmed, *as_assumed, *unmendable, *sure]), None)
    explaining = [*confirmed, *mending]
    if best not in explaining or best.cause is Cause.MOMENT_SCALE:
        broken = missing_axis(recording, MOMENTS)  # hands that turn freely exert none
    if best not in explaining:
        broken = broken or silent_sensor(recording, cutoff, is_whole=False) or saturated_sensor(recording)
        return broken or interrupted_sensor(recording) or _unexplained(found, misfit)
    if broken is not None:
        return broken
    unlike = (one for one in found if one.cause is not best.cause)
    second = next(one for one in unlike if one in mending or one.gain < best.gain)  # others leave more than noise
    robot, words = words_of(best, misfit)
    if best.cause is Cause.GRAVITY:
        off, wrong = _not_level(suspects.homes @ recording.gravity, best.value, evidence)
        if 0 < len(wrong) < len(off):
            robot = wrong[0] if len(wrong) == 1 else None
            words = f"the home frame of {', '.join(wrong)} is tilted, by {max(off):.3g} degrees against gravity"
    margin = best.gain - second.gain
    is_open = is_ambiguous(best, len(recording.names)) or (is_unit_of_all(best) and best.cause != assumed)
    alike = [] if is_open else [one for one in confirmed if one is not best and one.cause is best.cause]
    is_open = is_open or any(_apart(best.fit, one.fit) > _ALIKE for one in alike)
    leaves_much = best not in confirmed and bool(best.fit.excess >= _EXCESS + _SLACK)
    mass = None if is_open or leaves_much else best.fit.mass
    with_it = "" if mass is None else f". With it estimated along, the mass is {mass[0]:.4g} kg (std {mass[1]:.2g} kg)"
    others = [words_of(one, misfit) for one in alike]
    rest = "".join(f"; or {each}" for _, each in others) + (": which of these is not known" if others else "")
    if margin < _CLOSE:
        rest += f"; another fault, {second.cause.value}, explains it nearly as well"
    if leaves_much:
        rest += f"; it leaves {np.sqrt(best.fit.inside):.2g} times what noise explains: there may be another besides"
    return replace(
        _verdict_of(best, robot, suspects.homes),
        rivals=tuple(name or ALL for name, _ in others),
        words=f"{_misfits(plain)}. One fault explains {'most of ' * leaves_much}this: {words}{rest}{with_it}",
        ratio=float(np.sqrt(plain.inside)),
        margin=margin,
        second=second.cause.value,
        mass=mass,
        is_open=is_open,
    )


def _misfits(plain: Fit) -> str:
    return f"forces differ from any rigid body's by {np.sqrt(plain.inside):.2g} times what noise explains"


def _unexplained(found: Sequence[Suspect], misfit: WrenchMisfit) -> Verdict:
    """No fault leaves only noise; ``found`` are all, the likeliest first."""
    likeliest, plain = found[0], misfit.plain
    second = next(one for one in found if one.cause is not likeliest.cause)
    left = misfit.total - misfit.regressor @ plain.solution[:BODY_NUMBERS]
    worst = int(np.argmax(np.linalg.norm(left / np.std(left, axis=0), axis=1)))
    share = float(np.linalg.norm(left[:, :3]) / np.linalg.norm(misfit.total[:, :3]))
    carried = ", or does something else that was not recorded also carry the load" if share > _CARRIED else ""
    return Verdict(
        Cause.UNKNOWN,
        words=f"{_misfits(plain)}, most at {misfit.signals.time[worst]:.1f} s, and no single cause explains it; the "
        f"likeliest is that {words_of(likeliest, misfit)[1]}. Are the robots calibrated "
        f"(--calibrate)? Did something happen meanwhile (choose a part with --from and --to){carried}?",
        ratio=float(np.sqrt(plain.inside)),
        margin=likeliest.gain - second.gain,
        second=second.cause.value,
    )


def _apart(one: Fit, other: Fit) -> float:
    """Largest difference between two fits of the load, in standard deviations."""
    known = slice(BODY_NUMBERS)
    std = np.sqrt(np.maximum(np.diag(one.covariance)[known], 1e-300))
    return float(np.max(np.abs(one.solution[known] - other.solution[known]) / std))


def _verdict_of(suspect: Suspect, robot: str | None, homes: Array) -> Verdict:
    """The fault and its parameters, without words."""
    gravity = suspect.value @ homes if suspect.cause is Cause.GRAVITY else None
    return Verdict(suspect.cause, robot, tuple(suspect.value.tolist()), gravity=gravity)


def _confirmed(suspects: Sequence[Suspect], evidence: Evidence, homes: Array) -> list[Suspect]:
    """Find the likeliest faults whose correction leaves a right recording, also by the noise that sensors then have.

    A unit that is a thousand times too small makes the noise look a thousand times larger, which hides all else. Among
    nearly equally likely faults, those are chosen whose correction makes the robots' sensors most alike.
    """
    confirmed: list[tuple[tuple[int, bool], Suspect]] = []
    for suspect in sorted(suspects, key=_is_odd)[:_CONFIRMED]:
        if (confirmed and suspect.gain < confirmed[0][1].gain - _CLOSE) or suspect.cause not in MENDABLE:
            break
        name = None if suspect.robot is None else evidence.recording.names[suspect.robot]
        mended = mend(evidence.recording, _verdict_of(suspect, name, homes), evidence.poses)
        without = WrenchMisfit(replace(evidence, recording=mended, signals=signals_of(mended, evidence.cutoff)))
        if without.plain.excess < _EXCESS + _SLACK:
            sizes = [[np.trace(own[:3, :3]), np.trace(own[3:, 3:])] for own in without.noise]
            again = Suspects(without).scaled_again(suspect) if _is_unsure_scale(suspect) else suspect
            unlike = np.ptp(0.5 * np.log(np.array(sizes) + 1e-300), axis=0).max()
            confirmed.append(((round(float(unlike)), _is_odd(again)), again))
    least = min((rank for rank, _ in confirmed), default=None)
    return [suspect for rank, suspect in confirmed if rank == least]


def _is_scale(suspect: Suspect) -> bool:
    return suspect.cause in (Cause.SCALE, Cause.FORCE_SCALE, Cause.MOMENT_SCALE, Cause.AXIS_SCALE)


def _is_unsure_scale(suspect: Suspect) -> bool:
    """Whether the factor of a fault of scale is known badly."""
    if not _is_scale(suspect) or suspect.cause is Cause.AXIS_SCALE or len(suspect.fit.solution) == BODY_NUMBERS:
        return False  # the last: that of ``forces_instead`` follows from a fit to moments
    share, variance = 1.0 - suspect.fit.solution[BODY_NUMBERS], suspect.fit.covariance[BODY_NUMBERS, BODY_NUMBERS]
    return bool(variance > (_ROUGH * share) ** 2)


def _is_odd(suspect: Suspect) -> bool:
    """Whether readings would have the opposite sign and also another unit."""
    return _is_scale(suspect) and suspect.value[0] < 0.0 and abs(suspect.value[0] + 1.0) > _ALMOST


def _accepted(evidence: Evidence, plain: Fit, suspects: Sequence[Suspect], mended: Sequence[Verdict]) -> Verdict:
    """No fault, but what faults that are not significant add to the covariance: they bias the fit by little more.

    A fault that was corrected adds its uncertainty as well. What a calibration has estimated along is in the covariance
    already.
    """
    hiding = (Cause.LEVER, Cause.CLOCK) if evidence.tolerances is not None else _HIDING
    body = np.s_[:BODY_NUMBERS, :BODY_NUMBERS]
    added = [(one, one.fit.covariance[body] - plain.covariance[body]) for one in suspects if one.gain > -np.inf]
    corrected = [[more for one, more in added if _is_of(one, verdict, evidence.recording.names)] for verdict in mended]
    hidden = tuple((one.cause, more) for one, more in added if one.cause in hiding)
    if evidence.recording.has("acceleration"):
        scale = float(np.mean(gravity_factors(evidence))) - 1.0
        theta = plain.solution[:BODY_NUMBERS]
        hidden += ((Cause.MOTION, scale**2 * np.outer(theta, theta)),)
    return Verdict(hidden=hidden, corrections=tuple(more for each in corrected for more in each[:1]))


def _is_of(suspect: Suspect, verdict: Verdict, names: Sequence[str]) -> bool:
    """Whether a suspect has the unknowns for which a recording of these robots was corrected."""
    cause = Cause.GRAVITY if verdict.cause is Cause.NOT_LEVEL else verdict.cause  # of which forces tell the direction
    if suspect.cause is not cause or cause not in _UNCERTAIN:
        return False
    if cause in (Cause.OFFSET, Cause.DRIFT, Cause.GRAVITY):
        return True
    is_same_axis = cause is not Cause.AXIS_SCALE or suspect.value[1] == verdict.value[1]
    return is_same_axis and verdict.robot == (None if suspect.robot is None else names[suspect.robot])


def _mends(suspect: Suspect, excess: float) -> bool:
    """Whether a fault explains the whole excess."""
    may_leave = suspect.belongs and not (_is_scale(suspect) and not is_likely(suspect.cause, float(suspect.value[0])))
    left = max(_EXCESS + _SLACK, _MENDED * excess) if may_leave else _EXCESS + _SLACK
    return suspect.gain > -np.inf and suspect.fit.excess < left


def _not_level(down: Array, gravity: Array, evidence: Evidence) -> tuple[list[float], list[str]]:
    """Angles [degrees] between directions down (N, 3) and gravity (3,), and the names of the robots that are off."""
    off = [angle_deg(one, gravity) for one in down]
    least = max(_OFF * max(off), _SURE * np.degrees(evidence.turns))
    return off, [name for name, angle in zip(evidence.recording.names, off, strict=True) if angle > least]


def _level(evidence: Evidence, suspects: Suspects, plain: Fit) -> Verdict | None:
    """Find home frames whose z axes are not parallel; forces tell which of them are not level."""
    gravity = evidence.recording.gravity
    down = suspects.homes @ (gravity / np.linalg.norm(gravity))
    apart = max((angle_deg(one, other) for one in down for other in down), default=0.0)
    if apart < _LEVEL + _SURE * np.degrees(evidence.turns):
        return None
    ratio = float(np.sqrt(plain.inside))
    by_forces = suspects.direction_of_gravity()
    not_level = f"home frames are not level with each other, by {apart:.3g} degrees"
    if not _mends(by_forces, plain.excess):
        words = (
            f"{not_level}, but forces are those of a load in none of them: are poses those of grasp frames in the home "
            f"frames, and not the other way round? Are wrenches in the axes of the grasp frames?"
        )
        return Verdict(Cause.UNKNOWN, words=words, ratio=ratio)
    off, wrong = _not_level(down, by_forces.value, evidence)
    who = ", ".join(wrong)
    mass, std = by_forces.fit.mass
    words = (
        f"{not_level}; by what forces say of gravity it is {who}, turned by {max(off):.3g} degrees. With gravity where "
        f"forces have it, the mass is {mass:.4g} kg (std {std:.2g} kg). Turn the poses of {who} into a frame whose z "
        f"axis points up"
    )
    robot, gravity = wrong[0] if len(wrong) == 1 else None, by_forces.value @ suspects.homes
    return Verdict(Cause.NOT_LEVEL, robot, tuple(off), words, ratio=ratio, mass=(mass, std), gravity=gravity)
