"""Whether forces are those of one rigid body, and if not, what would mend it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.sensors import silent_sensor
from coheft.estimation.batch.judge.suspects import Suspect, Suspects
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.batch.judge.words import angle_deg, is_ambiguous, words_of
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, Fit, WrenchMisfit
from coheft.estimation.batch.recording import Recording
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.spatial import Array, Pose


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
_LEVEL = 0.5
"""Home frames that differ by more are not level [degrees], if poses show it by ``_SURE`` of their deviations."""
_SURE = 6.0


def judge_forces(
    recording: Recording, signals: Signals, poses: Sequence[Pose], turns: float, cutoff: float, assumed: str | None
) -> Verdict | None:
    """Judge whether the forces of a recording are those of one rigid body.

    Args:
        recording: With poses and wrenches; without twists and accelerations of its own.
        signals: Of it, filtered.
        poses: Of grasp frames in a frame at their middle.
        turns: Largest standard deviation of their rotations [rad].
        cutoff: Of the filter [Hz].
        assumed: The cause that the user names; None: the one that explains most.

    Returns:
        None if samples are too few per second to tell noise from motion.
    """
    try:
        misfit = WrenchMisfit(recording, signals, poses, cutoff)
    except ValueError:
        return None
    homes = _homes(signals, poses)
    plain = misfit.plain
    ratio = float(np.sqrt(plain.inside))
    suspects = Suspects(misfit, homes, recording.gravity)
    level = _level(homes, recording, turns, suspects, plain)
    if level is not None:
        return level
    found = suspects.all()
    sure = [one for one in found if one.gain > BARS.gain]
    if not sure and not (plain.excess > BARS.excess and misfit.share() > BARS.share):
        return Verdict.accepted(plain, found, assumed)
    mending = (one for one in found if one.cause == assumed and _mends(one, plain.excess))
    best = next(mending, (sure or found)[0])
    second = next(one for one in found if one.cause is not best.cause)
    is_mended = _mends(best, plain.excess)
    robot, words = words_of(best, recording, misfit)
    differs = f"forces differ from any rigid body's by {ratio:.2g} times what noise explains"
    margin = best.gain - second.gain
    if not sure or not is_mended:
        return silent_sensor(recording, cutoff) or Verdict(
            is_refuted=True,
            cause=Cause.UNKNOWN,
            ratio=ratio,
            margin=margin,
            second=second.cause.value,
            words=f"{differs}, most at {_worst(misfit):.1f} s, and no single cause explains it; most like it is that "
            f"{words}. Are the robots calibrated (--calibrate)? Did something happen meanwhile (--from and --to "
            f"choose a part)?",
        )
    mass = None if is_ambiguous(best, recording) else _mass_of(best.fit)
    with_it = "" if mass is None else f". With it estimated along, the mass is {mass[0]:.4g} kg (std {mass[1]:.2g} kg)"
    rest = f"; the second best cause, {second.cause.value}, is hardly worse" if margin < 10.0 else ""
    return Verdict(
        is_refuted=True,
        cause=best.cause,
        robot=robot,
        value=tuple(float(number) for number in (*best.value, *(() if best.time is None else (best.time,)))),
        ratio=ratio,
        margin=margin,
        second=second.cause.value,
        mass=mass,
        gravity=best.value @ homes if best.cause is Cause.GRAVITY else None,
        words=f"{differs}. One cause mends it: {words}{rest}{with_it}",
    )


def _mass_of(fit: Fit) -> tuple[float, float]:
    """Mass and its standard deviation [kg]."""
    return float(fit.solution[0]), float(np.sqrt(max(fit.covariance[0, 0], 0.0)))


def _mends(suspect: Suspect, excess: float) -> bool:
    """Whether a cause is the whole story."""
    return suspect.gain > -np.inf and suspect.fit.excess < max(BARS.excess + 0.5, BARS.mended * excess)


def _worst(misfit: WrenchMisfit) -> float:
    """Time at which the body explains least of the wrench [s]."""
    left = misfit.total - misfit.regressor @ misfit.plain.solution[:BODY_NUMBERS]
    sizes = np.linalg.norm(left / np.std(left, axis=0), axis=1)
    return float(misfit.signals.time[int(np.argmax(sizes))])


def _homes(signals: Signals, poses: Sequence[Pose]) -> Array:
    """Rotations of all home frames in the first one's, shape (N, 3, 3), by where all robots see the body."""
    assert signals.rotation is not None
    seen = [rotation @ pose.rotation.T for rotation, pose in zip(signals.rotation, poses, strict=True)]
    return np.array([Rotation.from_matrix(seen[0] @ own.swapaxes(-1, -2)).mean().as_matrix() for own in seen])


def _level(homes: Array, recording: Recording, turns: float, suspects: Suspects, plain: Fit) -> Verdict | None:
    """Home frames whose gravity is not the same, and whose it is, by what forces say."""
    down = homes @ (recording.gravity / np.linalg.norm(recording.gravity))
    apart = max(angle_deg(one, other) for one in down for other in down)
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
