"""Sentences about faults, which robot has them, and other units of forces and moments."""

import numpy as np

from coheft.estimation.batch.judge.sensors import AXES
from coheft.estimation.batch.judge.suspects import Suspect
from coheft.estimation.batch.judge.turned import turned_words
from coheft.estimation.batch.judge.verdict import Cause
from coheft.estimation.batch.judge.wrench_misfit import WrenchMisfit
from coheft.estimation.geometry.spatial import Array

_TARED = 0.2
"""Time from the beginning in which sensors that were tared with the load in hand read zero [s]."""
_QUIET = 6.0
KGF, LBF, _FOOT, _INCH = 9.80665, 4.4482216, 0.3048, 0.0254
"""In units of N and m."""
_UNITS = {
    Cause.SCALE: ((1.0 / KGF, "kgf and kgf·m"), (0.001, "kN and kN·m"), (1000.0, "mN and N·mm")),
    Cause.FORCE_SCALE: ((1.0 / KGF, "kgf"), (1.0 / LBF, "lbf"), (0.001, "kN")),
    Cause.MOMENT_SCALE: (
        *((1000.0, "N·mm"), (100.0, "N·cm"), (1.0 / KGF, "kgf·m"), (100.0 / KGF, "kgf·cm")),
        *((1.0 / (LBF * _FOOT), "lbf·ft"), (1.0 / (LBF * _INCH), "lbf·in")),
    ),
}
"""Names of units, and how many of them are one of the expected unit."""
_ALIKE = 0.03
"""Relative difference of a factor from that of a unit."""
_NEAR = 2.0
"""Factors between one and this, or their inverses, may be a calibration."""


def words_of(suspect: Suspect, misfit: WrenchMisfit) -> tuple[str | None, str]:
    """The name of the robot that has the fault, None if it is not a single one, and the fault in words."""
    recording, value = misfit.evidence.recording, suspect.value
    names = recording.names
    name = None if suspect.robot is None else names[suspect.robot]
    whose = "all robots" if name is None else name
    match suspect.cause:
        case Cause.OFFSET:
            return _offset_words(value, misfit)
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
            if is_ambiguous(suspect, len(names)):
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
            name, size = _likeliest(value[6:], misfit)
            return name, (
                f"the zero of {name}'s sensor drifts, by {size} per minute (another robot's could instead, with "
                f"moments that go with it)"
            )
        case Cause.COMPENSATED:
            return _weight_words(value, misfit)
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


def _offset_words(offset: Array, misfit: WrenchMisfit) -> tuple[str | None, str]:
    """Words for an offset, of the robot whose sensor needs the least moment for it."""
    recording = misfit.evidence.recording
    wrenches = recording.stacked("wrench")
    first = wrenches[:, : max(5, int(_TARED * recording.rate))]
    deviations = np.sqrt([np.diag(noise) * recording.rate / misfit.signals.rate for noise in misfit.noise])
    level = _QUIET * deviations / np.sqrt(first.shape[1]) + 0.02 * np.sqrt(np.mean(wrenches**2, axis=1))
    if np.all(np.abs(first.mean(axis=1)) < level):
        return None, "all sensors read zero at the beginning: they were tared while the robots held the load"
    name, size = _likeliest(offset, misfit)
    return name, (
        f"the wrench of {name} is off by {size}: was its sensor tared? (Another robot's could be off instead, with "
        f"moments that go with it)"
    )


def _weight_words(value: Array, misfit: WrenchMisfit) -> tuple[str | None, str]:
    mass = float(value[0])
    away = [float(np.linalg.norm(value[1:] / mass - pose.translation)) for pose in misfit.poses]
    name = misfit.evidence.recording.names[int(np.argmin(away))]
    near = f"{name} is nearest, at {min(away):.2g} m from its grasp frame"
    if mass < 0.0:
        return None, f"forces do not carry the weight of {-mass:.3g} kg: a controller has compensated it ({near})"
    return None, (
        f"forces also carry {mass:.3g} kg that do not move with the load ({near}): a tool, whose weight is not "
        f"compensated, or something else that the load is connected with"
    )


def _likeliest(wrench: Array, misfit: WrenchMisfit) -> tuple[str, str]:
    """The robot whose sensor needs the least moment for a wrench (6,) in the body frame, and that wrench in words."""
    own = [np.linalg.inv(adjoint) @ wrench for adjoint in misfit.adjoints]
    arms = [float(np.linalg.norm(one[3:])) / max(float(np.linalg.norm(one[:3])), 1e-9) for one in own]
    robot = int(np.argmin(arms))
    fx, fy, fz, mx, my, mz = own[robot]
    name = misfit.evidence.recording.names[robot]
    return name, f"({fx:.2f}, {fy:.2f}, {fz:.2f}) N and ({mx:.3f}, {my:.3f}, {mz:.3f}) N·m"


def is_ambiguous(suspect: Suspect, robots: int) -> bool:
    """Whether of two robots either may have a wrong scale: one too large or the other too small."""
    is_one = suspect.robot is not None and robots == 2
    return is_one and suspect.cause in (Cause.SCALE, Cause.FORCE_SCALE) and suspect.value[0] > 0.0


def is_unit_of_all(suspect: Suspect) -> bool:
    """Whether all forces or all moments may be in another unit."""
    is_all = suspect.robot is None and suspect.cause in (Cause.MOMENT_SCALE, Cause.FORCE_SCALE)
    return is_all and suspect.value[0] > 0.0


def angle_deg(one: Array, other: Array) -> float:
    """Angle between two vectors (3,) [degrees]."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), one @ other)))


def unit_of(cause: Cause, factor: float) -> str:
    """The unit with this factor; empty if none is known."""
    return next((unit for size, unit in _UNITS.get(cause, ()) if abs(factor / size - 1.0) < _ALIKE), "")


def is_likely(cause: Cause, factor: float) -> bool:
    """Whether a factor is that of a sign, of a calibration, or of a unit."""
    size = abs(factor)
    if 1.0 / _NEAR < size < _NEAR or unit_of(cause, factor):
        return True
    # That of all moments may be one of all forces.
    return cause is Cause.MOMENT_SCALE and size > 0.0 and bool(unit_of(Cause.FORCE_SCALE, 1.0 / factor))
