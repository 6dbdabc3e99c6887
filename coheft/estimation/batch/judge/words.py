"""Sentences about faults, and which robot has them."""

import numpy as np

from coheft.estimation.batch.judge.sensors import AXES
from coheft.estimation.batch.judge.suspects import Suspect
from coheft.estimation.batch.judge.turned import turned_words
from coheft.estimation.batch.judge.units import unit_of
from coheft.estimation.batch.judge.verdict import Cause
from coheft.estimation.batch.judge.wrench_misfit import WrenchMisfit
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array

_TARED = 0.2
"""Time from the beginning in which sensors that were tared with the load in hand read zero [s]."""
_QUIET = 6.0


def words_of(suspect: Suspect, recording: Recording, misfit: WrenchMisfit) -> tuple[str | None, str]:
    """The name of the robot that has the fault, None if it is not a single one, and the fault in words."""
    names, value = recording.names, suspect.value
    name = None if suspect.robot is None else names[suspect.robot]
    whose = "all robots" if name is None else name
    match suspect.cause:
        case Cause.OFFSET:
            return _offset_words(value, recording, misfit)
        case Cause.LEVER:
            x, y, z = 1000.0 * value
            return name, (
                f"moments of {whose} are about another point than the origin of the grasp frame, which lies at "
                f"({x:.1f}, {y:.1f}, {z:.1f}) mm from that point"
            )
        case Cause.SCALE | Cause.FORCE_SCALE | Cause.MOMENT_SCALE:
            what = {Cause.SCALE: "forces and moments", Cause.FORCE_SCALE: "forces"}.get(suspect.cause, "moments")
            if not suspect.belongs:
                return name, f"{what} of {whose} have nothing to do with the load"
            if value[0] < 0.0:
                return name, f"{what} of {whose} have the opposite sign (a factor of {value[0]:.3g})"
            unit = unit_of(suspect.cause, float(value[0]))
            factor = f"{what} of {whose} are {value[0]:.4g} times what they should be"
            if is_unit_of_all(suspect):
                others = "moments" if suspect.cause is Cause.FORCE_SCALE else "forces"
                return None, (
                    f"{factor}, or {others} {1.0 / value[0]:.4g} times: no motion tells which, but their units do "
                    f"(--assume 'moment scale' or 'force scale')"
                )
            if is_ambiguous(suspect, recording):
                other = names[1 - (suspect.robot or 0)]
                return None, f"{factor}, or those of {other} {1.0 / value[0]:.4g} times, which two robots cannot tell"
            return name, f"{factor}: {unit or 'another unit, or calibration'}"
        case Cause.AXIS_SCALE:
            axis = AXES[int(value[1])]
            if not suspect.belongs:
                return name, f"{axis} of {name} has nothing to do with the load"
            if value[0] < 0.0:
                return name, f"{axis} of {name} has the opposite sign (a factor of {value[0]:.3g})"
            return name, f"{axis} of {name} is {value[0]:.4g} times what it should be"
        case Cause.BASE_AXES:
            what = "the wrench" if value.all() else "only the force" if value[0] else "only the moment"
            return name, f"{what} of {whose} is in the axes of the home frame, not of the grasp frame"
        case Cause.HOME_MOMENTS:
            axes = ", and the whole wrench is in its axes" if value[0] else ""
            return name, f"moments of {whose} are about the origin of the home frame, not of the grasp frame{axes}"
        case Cause.TURNED:
            return name, turned_words(value.reshape(3, 3), whose)
        case Cause.EXCHANGED:
            return name, f"what {whose} gives as forces are moments, and the other way round: swap the columns"
        case Cause.SWAPPED:
            one, other = (names[int(index)] for index in value)
            return None, f"wrenches of {one} are those of {other}, and the other way round: swap them, or the poses"
        case Cause.DRIFT:
            name, size = _likeliest(value[6:], recording, misfit)
            return name, (
                f"the zero of {name}'s sensor drifts, by {size} per minute (another robot's could instead, with "
                f"moments that go with it)"
            )
        case Cause.COMPENSATED:
            return _weight_words(value, recording, misfit)
        case Cause.CLOCK:
            late = "late" if value[0] > 0.0 else "early"
            clocks = f"wrenches of {whose} are {abs(1000.0 * value[0]):.3g} ms {late} against poses"
            return name, clocks if name else f"{clocks}, or poses of some robot are off in time"
        case Cause.TIME:
            return None, (
                f"times are {value[0]:.4g} times as long as forces say: another unit or rate, or gravity is not "
                f"{np.linalg.norm(recording.gravity):.4g} m/s²"
            )
        case Cause.LENGTH_SCALE:
            return None, f"lengths of all robots are {value[0]:.4g} times what they should be: another unit"
        case Cause.GRAVITY:
            angle = angle_deg(value, recording.gravity)
            return None, f"home frames are all tilted, by {angle:.3g} degrees against gravity"
        case Cause.LOAD_CHANGE:
            return None, f"the load changed at {value[-1]:.1f} s; --from and --to choose a part"
        case Cause.OFFSET_JUMP:
            return None, f"the zero of some sensor jumped at {value[-1]:.1f} s; --from and --to choose a part"
        case cause:
            raise ValueError(f"expected a cause that forces have, found {cause}")


def _offset_words(offset: Array, recording: Recording, misfit: WrenchMisfit) -> tuple[str | None, str]:
    """Words for an offset, of the robot whose sensor needs the least moment for it."""
    wrenches = recording.stacked("wrench")
    first = wrenches[:, : max(5, int(_TARED * recording.rate))]
    deviations = np.sqrt([np.diag(noise) * recording.rate / misfit.signals.rate for noise in misfit.noise])
    level = _QUIET * deviations / np.sqrt(first.shape[1]) + 0.02 * np.sqrt(np.mean(wrenches**2, axis=1))
    if np.all(np.abs(first.mean(axis=1)) < level):
        return None, "all sensors read zero at the beginning: they were tared while the robots held the load"
    name, size = _likeliest(offset, recording, misfit)
    return name, (
        f"the wrench of {name} is off by {size}: was its sensor tared? (Another robot's could be off instead, with "
        f"moments that go with it)"
    )


def _weight_words(value: Array, recording: Recording, misfit: WrenchMisfit) -> tuple[str | None, str]:
    mass = float(value[0])
    away = [float(np.linalg.norm(value[1:] / mass - pose.translation)) for pose in misfit.poses]
    near = f"{recording.names[int(np.argmin(away))]} is nearest, at {min(away):.2g} m from its grasp frame"
    if mass < 0.0:
        return None, f"forces do not carry the weight of {-mass:.3g} kg: a controller has compensated it ({near})"
    return None, (
        f"forces also carry {mass:.3g} kg that do not move with the load ({near}): a tool, whose weight is not "
        f"compensated, or something else that the load is connected with"
    )


def _likeliest(wrench: Array, recording: Recording, misfit: WrenchMisfit) -> tuple[str, str]:
    """The robot whose sensor needs the least moment for a wrench (6,) in the body frame, and that wrench in words."""
    own = [np.linalg.inv(adjoint) @ wrench for adjoint in misfit.adjoints]
    arms = [float(np.linalg.norm(one[3:])) / max(float(np.linalg.norm(one[:3])), 1e-9) for one in own]
    robot = int(np.argmin(arms))
    fx, fy, fz, mx, my, mz = own[robot]
    return recording.names[robot], f"({fx:.2f}, {fy:.2f}, {fz:.2f}) N and ({mx:.3f}, {my:.3f}, {mz:.3f}) N·m"


def is_ambiguous(suspect: Suspect, recording: Recording) -> bool:
    """Whether either of two robots may have a wrong scale: one too large or the other too small."""
    is_one = suspect.robot is not None and len(recording.names) == 2
    return is_one and suspect.cause in (Cause.SCALE, Cause.FORCE_SCALE) and suspect.value[0] > 0.0


def is_unit_of_all(suspect: Suspect) -> bool:
    """Whether all forces or all moments may be in another unit."""
    is_all = suspect.robot is None and suspect.cause in (Cause.MOMENT_SCALE, Cause.FORCE_SCALE)
    return is_all and suspect.value[0] > 0.0


def angle_deg(one: Array, other: Array) -> float:
    """Angle between two vectors (3,) [degrees]."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))
