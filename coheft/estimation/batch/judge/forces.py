"""Whether forces are those of one rigid body, and if not, what would mend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.mend import MENDABLE, mend
from coheft.estimation.batch.judge.sensors import silent_sensor
from coheft.estimation.batch.judge.suspects import Suspect, Suspects, forces_instead
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.judge.words import angle_deg, is_ambiguous, is_unit_of_all, words_of
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, Fit, WrenchMisfit
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array


@dataclass(frozen=True)
class Bars:
    """From when on something is more than chance.

    Attributes:
        excess: Of residuals, in their own deviations.
        gain: Of one cause, see ``Suspect.gain``.
        share: Of what changes in the wrench; a smaller misfit without a cause hardly matters.
        mended: Share of the excess that a cause may leave if it is the whole story.
    """

    excess: float = 4.5
    gain: float = 6.0
    share: float = 0.02
    mended: float = 0.02


BARS = Bars()
_SLACK = 0.5
"""Of the excess, for what a cause leaves."""
_CONFIRMED = 6
"""So many causes are tried."""
_CLOSE = 10.0
"""Causes whose gains differ by less are nearly as likely."""
_HIDING = (Cause.OFFSET, Cause.LEVER, Cause.SCALE, Cause.FORCE_SCALE, Cause.CLOCK, Cause.GRAVITY)
"""What sensors may well have without its being noticed."""
_LEVEL = 0.5
"""Home frames that differ by more are not level [degrees], if poses show it by ``_SURE`` of their deviations."""
_SURE = 6.0


def judge_forces(evidence: Evidence, assumed: str | None) -> Verdict:
    """Judge whether the forces of a recording are those of one rigid body.

    Args:
        evidence: On it.
        assumed: The cause that the user names; None: the one that explains most.

    Raises:
        ValueError: There are too few samples, or too few per second, to tell noise from motion.
    """
    recording = evidence.recording
    misfit = WrenchMisfit(evidence)
    homes = _homes(misfit)
    plain = misfit.plain
    suspects = Suspects(misfit, homes, recording.gravity)
    level = _level(homes, recording, evidence.turns, suspects, plain)
    if level is not None:
        return level
    found = suspects.all()
    if assumed == Cause.FORCE_SCALE:
        found += [forces_instead(one) for one in found if is_unit_of_all(one)]
    sure = [one for one in found if one.gain > BARS.gain]
    if not sure and not (plain.excess > BARS.excess and misfit.share() > BARS.share):
        return _accepted(evidence, plain, found, assumed)
    silent = silent_sensor(recording, evidence.cutoff)  # a factor of thousands would mend its noise as well
    if silent is not None:
        return silent
    mending = [one for one in sure if _mends(one, plain.excess)]
    as_assumed = [one for one in mending if one.cause == assumed]
    best = _confirmed(as_assumed or mending, evidence, homes) or next(iter(as_assumed or sure), None)
    if best not in mending:
        return _unknown(found, misfit)
    others = (one for one in found if one.cause is not best.cause)
    second = next(one for one in others if one in mending or one.gain < best.gain)  # others leave more than noise
    robot, words = words_of(best, recording, misfit)
    margin = best.gain - second.gain
    is_open = is_ambiguous(best, recording) or (is_unit_of_all(best) and best.cause != assumed)
    mass = None if is_open else _mass_of(best.fit)
    with_it = "" if mass is None else f". With it estimated along, the mass is {mass[0]:.4g} kg (std {mass[1]:.2g} kg)"
    rest = f"; the second best cause, {second.cause.value}, is hardly worse" if margin < _CLOSE else ""
    return replace(
        _verdict_of(best, robot, homes, float(np.sqrt(plain.inside))),
        is_open=is_open,
        margin=margin,
        second=second.cause.value,
        mass=mass,
        words=f"{_differs(misfit)}. One cause mends it: {words}{rest}{with_it}",
    )


def _verdict_of(suspect: Suspect, robot: str | None, homes: Array, ratio: float) -> Verdict:
    return Verdict(
        is_refuted=True,
        cause=suspect.cause,
        robot=robot,
        value=tuple(float(number) for number in (*suspect.value, *(() if suspect.time is None else (suspect.time,)))),
        ratio=ratio,
        gravity=suspect.value @ homes if suspect.cause is Cause.GRAVITY else None,
    )


def _unknown(found: Sequence[Suspect], misfit: WrenchMisfit) -> Verdict:
    """No single cause explains what is seen."""
    best = found[0]
    second = next(one for one in found if one.cause is not best.cause)
    _, words = words_of(best, misfit.evidence.recording, misfit)
    return Verdict(
        is_refuted=True,
        cause=Cause.UNKNOWN,
        ratio=float(np.sqrt(misfit.plain.inside)),
        margin=best.gain - second.gain,
        second=second.cause.value,
        words=f"{_differs(misfit)}, most at {_worst(misfit):.1f} s, and no single cause explains it; most like it is "
        f"that {words}. Are the robots calibrated (--calibrate)? Did something happen meanwhile (--from and --to "
        f"choose a part)?",
    )


def _differs(misfit: WrenchMisfit) -> str:
    return f"forces differ from any rigid body's by {np.sqrt(misfit.plain.inside):.2g} times what noise explains"


def _confirmed(suspects: Sequence[Suspect], evidence: Evidence, homes: Array) -> Suspect | None:
    """The likeliest one without which the recording is right, also by the noise that its sensors then have.

    A unit that is a thousand times too small makes noise look a thousand times larger, beside which nothing else shows.
    Of those that are nearly as likely it is the one without which robots' sensors are most alike. None: there is none.
    """
    confirmed: list[tuple[int, Suspect]] = []
    for suspect in suspects[:_CONFIRMED]:
        if confirmed and suspect.gain < confirmed[0][1].gain - _CLOSE:
            break
        if suspect.cause not in MENDABLE:
            break
        name = None if suspect.robot is None else evidence.recording.names[suspect.robot]
        mended = mend(evidence.recording, _verdict_of(suspect, name, homes, 1.0), evidence.poses)
        without = WrenchMisfit(evidence.but(mended))
        if without.plain.excess < BARS.excess + _SLACK:
            sizes = [[np.trace(own[:3, :3]), np.trace(own[3:, 3:])] for own in without.noise]
            unlike = np.ptp(0.5 * np.log(np.array(sizes) + 1e-300), axis=0).max()
            confirmed.append((round(float(unlike)), suspect))
    return min(confirmed, key=lambda one: one[0])[1] if confirmed else None


def _accepted(evidence: Evidence, plain: Fit, suspects: Sequence[Suspect], assumed: str | None) -> Verdict:
    """Nothing speaks against the fit: what is not significant biases it by little more than it makes uncertain.

    So does a cause that was assumed, and taken out with its own uncertainty. What a calibration has estimated along is
    in the covariance already.
    """
    hiding = (Cause.LEVER, Cause.CLOCK) if evidence.tolerances is not None else _HIDING
    known = plain.covariance[:BODY_NUMBERS, :BODY_NUMBERS]
    hidden = tuple(
        (suspect.cause, suspect.fit.covariance[:BODY_NUMBERS, :BODY_NUMBERS] - known)
        for suspect in suspects
        if (suspect.cause in hiding or suspect.cause == assumed) and suspect.gain > -np.inf
    )
    return Verdict(is_refuted=False, hidden=hidden)


def _mass_of(fit: Fit) -> tuple[float, float]:
    """Mass and its standard deviation [kg]."""
    return float(fit.solution[0]), float(np.sqrt(max(fit.covariance[0, 0], 0.0)))


def _mends(suspect: Suspect, excess: float) -> bool:
    """Whether a cause is the whole story."""
    return suspect.gain > -np.inf and suspect.fit.excess < max(BARS.excess + _SLACK, BARS.mended * excess)


def _worst(misfit: WrenchMisfit) -> float:
    """Time at which the body explains least of the wrench [s]."""
    left = misfit.total - misfit.regressor @ misfit.plain.solution[:BODY_NUMBERS]
    sizes = np.linalg.norm(left / np.std(left, axis=0), axis=1)
    return float(misfit.signals.time[int(np.argmax(sizes))])


def _homes(misfit: WrenchMisfit) -> Array:
    """Rotations of all home frames in the first one's, shape (N, 3, 3), by where all robots see the body.

    None of them, shape (0, 3, 3), without poses.
    """
    rotations = misfit.signals.rotation
    if rotations is None:
        return np.zeros((0, 3, 3))
    seen = [rotation @ pose.rotation.T for rotation, pose in zip(rotations, misfit.poses, strict=True)]
    return np.array([Rotation.from_matrix(seen[0] @ own.swapaxes(-1, -2)).mean().as_matrix() for own in seen])


def _level(homes: Array, recording: Recording, turns: float, suspects: Suspects, plain: Fit) -> Verdict | None:
    """Home frames whose gravity is not the same, and whose it is, by what forces say."""
    down = homes @ (recording.gravity / np.linalg.norm(recording.gravity))
    apart = max((angle_deg(one, other) for one in down for other in down), default=0.0)
    if apart < _LEVEL + _SURE * np.degrees(turns):
        return None
    ratio = float(np.sqrt(plain.inside))
    by_forces = suspects.direction_of_gravity()
    if not _mends(by_forces, plain.excess):
        return Verdict(
            is_refuted=True,
            cause=Cause.UNKNOWN,
            ratio=ratio,
            words=f"home frames are not level with each other, by {apart:.3g} degrees, but forces are those of a load "
            f"in none of them: are poses those of grasp frames in the home frames, and not the other way round? Are "
            f"wrenches in the axes of the grasp frames?",
        )
    off = [angle_deg(one, by_forces.value) for one in down]
    wrong = [name for name, angle in zip(recording.names, off, strict=True) if angle > 0.2 * max(off)]
    who = ", ".join(wrong)
    mass, std = _mass_of(by_forces.fit)
    return Verdict(
        is_refuted=True,
        cause=Cause.NOT_LEVEL,
        robot=wrong[0] if len(wrong) == 1 else None,
        value=tuple(off),
        ratio=ratio,
        mass=(mass, std),
        gravity=by_forces.value @ homes,
        words=f"home frames are not level with each other, by {apart:.3g} degrees; by what forces say of gravity it is "
        f"{who}, turned by {max(off):.3g} degrees. With gravity where forces have it, the mass is {mass:.4g} kg (std "
        f"{std:.2g} kg). Turn the poses of {who} into a frame whose z axis points up",
    )
