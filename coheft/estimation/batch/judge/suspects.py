"""Possible faults of the forces of a recording, each fitted together with the load.

A fault adds columns to the regressor, or changes the total wrench or the motion. Its gain is a likelihood ratio minus a
cost, which grows with the number of its unknowns, and with the number of robots that may have it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from scipy.special import expit

from coheft.estimation.batch.judge.mend import about_grasp
from coheft.estimation.batch.judge.turned import fit_turned
from coheft.estimation.batch.judge.verdict import Cause
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, REWEIGHTINGS, Fit, WrenchMisfit
from coheft.estimation.batch.signals import regressor, signals_of, total_wrench
from coheft.estimation.geometry.body_motion import BODY_A
from coheft.estimation.geometry.spatial import Array, Pose, skew

_HEAVY = 3.0
"""A load has a mass, and readings belong to it, by at least so many standard deviations."""
_STEP = 0.06
"""Duration of a change of the load [s]."""
_LONGEST_DELAY, _DELAY_STEP, _DELAY_FOUND = 0.5, 0.05, 2e-4
_SLOWEST = 12.0
_TURNS, _TIME_TURNS = 8, 14
_TURNED = 1e-6
_SCALED = {
    Cause.SCALE: np.eye(6),
    Cause.FORCE_SCALE: np.diag([1.0, 1.0, 1.0, 0.0, 0.0, 0.0]),
    Cause.MOMENT_SCALE: np.diag([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
}
"""Which parts of a wrench have a wrong scale."""


@dataclass(frozen=True, eq=False)
class Suspect:
    """A possible fault, fitted.

    Attributes:
        cause: The fault.
        robot: Index of the robot that has it; None if all have it, or no robot in particular.
        fit: The fit of the load with this fault.
        gain: Twice the log likelihood ratio to the fit without a fault, minus the cost of the fault's unknowns.
        value: Its parameters: an offset (6,) in the body frame, a lever (3,) [m], a factor, and of which of six axes, a
            delay [s], gravity (3,), a sensor's axes (9,), an offset and its drift per minute (12,), the indices of two
            robots, or whether forces and moments have it, or axes have it besides, 0 or 1 each; for a change, the last
            one is its time [s].
        belongs: Whether readings of which the scale is wrong belong to the load: it fits no better without them.
    """

    cause: Cause
    robot: int | None
    fit: Fit
    gain: float
    value: Array
    belongs: bool = True


class Suspects:
    """All possible faults of a recording, of which ``misfit`` fits the total wrench.

    Attributes:
        homes: Rotations of all home frames in the first one's, from all robots' views of the body, shape (N, 3, 3);
            without poses there are none, shape (0, 3, 3).
    """

    def __init__(self, misfit: WrenchMisfit) -> None:
        self._misfit, self._gravity = misfit, misfit.evidence.recording.gravity
        self._count = len(misfit.adjoints)
        indices = list(range(self._count))
        self._one_or_all: dict[int | None, list[int]] = {**{robot: [robot] for robot in indices}, None: indices}
        self.homes = np.zeros((0, 3, 3))
        if misfit.rotations is not None:
            self._rotations = misfit.rotations
            to_first = self._rotations[0] @ self._rotations.swapaxes(-1, -2)
            self.homes = np.array([Rotation.from_matrix(own).mean().as_matrix() for own in to_first])
            self._gravity_in_body = np.mean(self._gravity @ self._rotations, axis=0)
            """Gravity in the body frame, mean over the robots, shape (n, 3)."""
        self._unknown_cost = float(np.log(misfit.plain.residual.size))
        self._robot_cost = 2.0 * float(np.log(self._count))

    def all(self) -> list[Suspect]:
        """All faults, the likeliest first."""
        found = [*self._offset(), *self._levers(), *self._scales(), *self._axis_scales(), *self._clocks()]
        found += [*self._turned(), *self._exchanged(), *self._swapped(), *self._changes()]
        if self._misfit.rotations is not None:
            found += [*self._axes(), *self._home_moments(), self._weight(), self.direction_of_gravity()]
            recording = self._misfit.evidence.recording
            if not recording.has("twist") and not recording.has("acceleration"):
                found += [self._time(), self._lengths()]
        return sorted(found, key=lambda suspect: -suspect.gain)

    def _suspect(self, cause: Cause, robot: int | None, fit: Fit, unknowns: int, value: Array | None = None) -> Suspect:
        cost = unknowns * self._unknown_cost + (self._robot_cost if robot is not None else 0.0)
        # A fault with which the load would have no mass is impossible.
        mass, std = fit.mass
        gain = self._misfit.plain.misfit - fit.misfit - cost if mass > _HEAVY * std else -np.inf
        return Suspect(cause, robot, fit, gain, fit.solution[BODY_NUMBERS:] if value is None else value)

    def _offset(self) -> Iterator[Suspect]:
        """A constant or drifting wrench; the total does not tell in which robot's sensor."""
        columns = np.broadcast_to(np.eye(6), (len(self._misfit.total), 6, 6))
        yield self._suspect(Cause.OFFSET, None, self._misfit.fit(columns), 6)
        minutes = (self._misfit.signals.time / 60.0)[:, None, None]
        yield self._suspect(
            Cause.DRIFT, None, self._misfit.fit(np.concatenate([columns, minutes * columns], axis=-1)), 12
        )

    def _levers(self) -> Iterator[Suspect]:
        """Moments about another point: ``t + l x f``."""
        maps = [np.block([[np.zeros((3, 6))], [skew(axis), np.zeros((3, 3))]]) for axis in np.eye(3)]
        for robot, robots in self._one_or_all.items():
            yield self._suspect(Cause.LEVER, robot, self._misfit.fit_readings(robots, maps), 3)

    def _scales(self) -> Iterator[Suspect]:
        """A wrong scale of forces and moments, of forces only, or of moments only."""
        for cause, scaled in _SCALED.items():
            for robot, robots in self._one_or_all.items():
                if robot is None and cause is not Cause.MOMENT_SCALE:
                    continue  # a common scale of forces looks like another mass
                yield self._scaled(cause, robot, robots, scaled)

    def _axis_scales(self) -> Iterator[Suspect]:
        """A wrong scale, or sign, of one axis of a sensor."""
        for robot in range(self._count):
            for axis, unit in enumerate(np.eye(6)):
                found = self._scaled(Cause.AXIS_SCALE, robot, [robot], np.diag(unit))
                value = np.array([found.value[0], axis])
                yield replace(found, gain=found.gain - 2.0 * float(np.log(6.0)), value=value)

    def _scaled(self, cause: Cause, robot: int | None, robots: list[int], scaled: Array) -> Suspect:
        fit = self._misfit.fit_readings(robots, [scaled])
        right = 1.0 - float(fit.solution[BODY_NUMBERS])  # share of a reading that belongs to the load
        std = float(np.sqrt(fit.covariance[BODY_NUMBERS, BODY_NUMBERS]))
        value = np.array([1.0 / right if abs(right) > 1e-6 else np.inf])
        return replace(self._suspect(cause, robot, fit, 1, value), belongs=abs(right) > _HEAVY * std)

    def scaled_again(self, suspect: Suspect) -> Suspect:
        """A fault of scale, fitted once more to a recording that was corrected for it; its factor is the whole one.

        The recording's noise is then known: that of readings in a unit that is too small seems to be large.
        """
        again = self._scaled(suspect.cause, suspect.robot, self._one_or_all[suspect.robot], _SCALED[suspect.cause])
        return replace(again, gain=suspect.gain, value=suspect.value * again.value)

    def _clocks(self) -> Iterator[Suspect]:
        """Late wrenches of one robot or of all."""
        time = self._misfit.signals.time
        splines = [CubicSpline(time, wrench) for wrench in self._misfit.wrenches]
        for robot, robots in self._one_or_all.items():
            delay = 0.0
            for _ in range(_TURNS):
                at = np.clip(time + delay, time[0], time[-1])
                moved = self._misfit.wrenches.copy()
                column = np.zeros((len(time), 6, 1))
                for own in robots:
                    moved[own] = splines[own](at)
                    column[..., 0] -= splines[own](at, 1) @ self._misfit.adjoints[own].T
                fit = self._misfit.fit(column, total=total_wrench(moved, self._misfit.poses))
                step = float(np.clip(fit.solution[BODY_NUMBERS], -_DELAY_STEP, _DELAY_STEP))
                delay = float(np.clip(delay + step, -_LONGEST_DELAY, _LONGEST_DELAY))
                if abs(step) < _DELAY_FOUND:
                    break
            yield self._suspect(Cause.CLOCK, robot, fit, 1, np.array([delay]))

    def _axes(self) -> Iterator[Suspect]:
        """Wrenches, or only their forces or moments, in the axes of the home frame instead of the grasp frame's."""
        rotation = self._misfit.signals.rotation
        assert rotation is not None
        halves = self._misfit.wrenches.reshape(*self._misfit.wrenches.shape[:2], 2, 3)
        turned = np.einsum("knji,knhj->knhi", rotation, halves).reshape(self._misfit.wrenches.shape)
        for halves_turned in ((1.0, 1.0), (1.0, 0.0), (0.0, 1.0)):
            mixed = np.where(np.repeat(halves_turned, 3) == 1.0, turned, self._misfit.wrenches)
            for robot in self._one_or_all:
                yield self._with_readings(Cause.BASE_AXES, robot, mixed, halves_turned)

    def _home_moments(self) -> Iterator[Suspect]:
        """Moments about the origin of the home frame, in the axes of the grasp frame or of the home frame."""
        evidence = self._misfit.evidence
        for is_turned in (False, True):
            recording = evidence.recording
            for name in recording.names:
                recording = about_grasp(recording, name, is_turned=is_turned)
            moved = signals_of(recording, evidence.cutoff).wrench
            for robot in self._one_or_all:
                yield self._with_readings(Cause.HOME_MOMENTS, robot, moved, [float(is_turned)])

    def _exchanged(self) -> Iterator[Suspect]:
        """One robot's moments given as forces and forces as moments; if all have it, it is found before."""
        for robot in range(self._count):
            yield self._with_readings(Cause.EXCHANGED, robot, self._misfit.wrenches[..., [3, 4, 5, 0, 1, 2]], [])

    def _swapped(self) -> Iterator[Suspect]:
        """Two robots' wrenches given for each other's."""
        for one, other in combinations(range(self._count), 2):
            order = np.arange(self._count)
            order[[one, other]] = other, one
            found = self._with_readings(Cause.SWAPPED, None, self._misfit.wrenches[order], [one, other])
            yield replace(found, gain=found.gain - 2.0 * self._robot_cost)

    def _with_readings(self, cause: Cause, robot: int | None, wrenches: Array, value: Sequence[float]) -> Suspect:
        """A fault without which this robot, or all, would have read these wrenches (N, n, 6)."""
        total = self._misfit.total_with(self._one_or_all[robot], wrenches)
        return self._suspect(cause, robot, self._misfit.fit(total=total), 1, np.array(value))

    def _turned(self) -> Iterator[Suspect]:
        """Sensors whose axes are rotated or exchanged."""
        for robot, robots in self._one_or_all.items():
            axes, fit = fit_turned(self._misfit, robots)
            yield self._suspect(Cause.TURNED, robot, fit, 3, axes.ravel())

    def _weight(self) -> Suspect:
        """Weight of something that does not move along, or, if negative, without what moves along."""
        return self._suspect(Cause.COMPENSATED, None, self._misfit.fit(self._regressor_at_rest()[..., :4]), 4)

    def _time(self) -> Suspect:
        """Times in a wrong unit: forces of inertia grow with the square of the factor, the weight does not."""
        factor, fit = self._rescaled(self._regressor_at_rest(), self._misfit.total)
        found = self._suspect(Cause.TIME, None, fit, 1, np.array([np.sqrt(factor)]))
        return found if 1.0 / _SLOWEST < found.value[0] < _SLOWEST else replace(found, gain=-np.inf)

    def _lengths(self) -> Suspect:
        """Lengths of all robots in a wrong unit: accelerations and lever arms have it, gravity and moments do not."""
        turning = [Pose(pose.rotation, np.zeros(3)) for pose in self._misfit.poses]
        still = self._misfit.motion.copy()
        still[:, BODY_A] = -self._gravity_in_body
        factor, fit = self._rescaled(regressor(still), total_wrench(self._misfit.wrenches, turning))
        return self._suspect(Cause.LENGTH_SCALE, None, fit, 1, np.array([1.0 / factor]))

    def _rescaled(self, kept: Array, kept_total: Array) -> tuple[float, Fit]:
        """The factor of all but these parts of the regressor (n, 6, 10) and the total wrench (n, 6), and the fit."""
        scaled, scaled_total, factor = self._misfit.regressor - kept, self._misfit.total - kept_total, 1.0
        for _ in range(_TIME_TURNS):
            columns, total = kept + factor * scaled, kept_total + factor * scaled_total
            body = self._misfit.fit(regressor=columns, total=total).solution
            fit = self._misfit.fit((scaled @ body - scaled_total)[..., None], regressor=columns, total=total)
            step = float(np.clip(fit.solution[BODY_NUMBERS], -0.5 * factor, factor))
            factor += step
            if abs(step) < _TURNED * factor:
                break
        return factor, fit

    def _regressor_at_rest(self) -> Array:
        """The body's regressor (n, 6, 10) for its weight alone."""
        still = np.zeros_like(self._misfit.motion)
        still[:, BODY_A] = -self._gravity_in_body
        return regressor(still)

    def _regressor(self, gravity: Array) -> Array:
        """The body's regressor (n, 6, 10) with this gravity (3,) in the first robot's home frame."""
        motion = self._misfit.motion.copy()
        motion[:, BODY_A] += self._gravity_in_body - self._in_body(gravity)
        return regressor(motion)

    def _in_body(self, vector: Array) -> Array:
        """A vector (3,) in the first home frame, in the body frame: mean over the robots, shape (n, 3)."""
        seen = [vector @ home @ own for home, own in zip(self.homes, self._rotations, strict=True)]
        result: Array = np.mean(seen, axis=0)
        return result

    def direction_of_gravity(self) -> Suspect:
        """Another direction of gravity in the first robot's home frame, found by forces."""
        size = float(np.linalg.norm(self._gravity))
        mean = np.mean(self.homes @ self._gravity, axis=0)
        mean *= size / max(float(np.linalg.norm(mean)), 1e-9)
        others = [*(self.homes @ self._gravity), *(size * np.vstack([np.eye(3), -np.eye(3)]))]
        rough = sorted(others, key=lambda start: self._misfit.fit(regressor=self._regressor(start)).misfit)
        best = min((self._tilted(start) for start in (mean, *rough[:2])), key=lambda found: found[1].misfit)
        return self._suspect(Cause.GRAVITY, None, best[1], 2, best[0])

    def _tilted(self, gravity: Array) -> tuple[Array, Fit]:
        """The best direction near this one, by Gauss-Newton, and the fit with it."""
        for _ in range(_TURNS):
            basis = np.linalg.svd(gravity[None])[2][1:]
            body = self._misfit.fit(regressor=self._regressor(gravity)).solution
            pulls = np.stack([-self._in_body(np.cross(axis, gravity)) for axis in basis], axis=-1)
            columns = np.concatenate([body[0] * pulls, np.cross(body[1:4], pulls, axisb=1, axisc=1)], axis=1)
            fit = self._misfit.fit(columns, regressor=self._regressor(gravity))
            turn = np.clip(fit.solution[BODY_NUMBERS:], -0.5, 0.5)
            if np.abs(turn).max() < _TURNED:
                break
            gravity = Rotation.from_rotvec(turn @ basis).apply(gravity)
        return gravity, fit

    def _changes(self) -> Iterator[Suspect]:
        """A change of the load, or of some sensor's offset, at some time."""
        zero = np.broadcast_to(np.eye(6), (len(self._misfit.total), 6, 6))
        for cause, columns in ((Cause.LOAD_CHANGE, self._misfit.regressor), (Cause.OFFSET_JUMP, zero)):
            time = self._misfit.signals.time
            tried = np.arange(time[0] + 1.0, time[-1] - 1.0, 1.0)
            if not len(tried):
                return

            def misfit(at: float, columns: Array = columns) -> float:
                return self._from(at, columns, passes=1).misfit

            rough = min(tried, key=misfit)
            limits = max(tried[0], rough - 1.0), min(tried[-1], rough + 1.0)  # not where filters distort the ends
            when = float(minimize_scalar(misfit, bounds=limits, method="bounded", options={"xatol": _STEP / 4.0}).x)
            found = self._suspect(cause, None, self._from(when, columns), columns.shape[-1])
            yield replace(found, gain=found.gain - 2.0 * float(np.log(len(tried))), value=np.append(found.value, when))

    def _from(self, time: float, columns: Array, passes: int = REWEIGHTINGS) -> Fit:
        later = expit((self._misfit.signals.time - time) / _STEP)
        return self._misfit.fit(columns * later[:, None, None], passes=passes)


def forces_instead(moments: Suspect) -> Suspect:
    """All forces too small instead of all moments too large: no motion tells these apart, but the load is another."""
    factor = float(moments.value[0])
    body = moments.fit.solution[:BODY_NUMBERS]
    by_factor = np.column_stack([factor * np.eye(BODY_NUMBERS), factor**2 * body])
    fit = replace(moments.fit, solution=factor * body, covariance=by_factor @ moments.fit.covariance @ by_factor.T)
    gain = moments.gain if 0.0 < factor < np.inf else -np.inf
    return Suspect(Cause.FORCE_SCALE, None, fit, gain, np.array([1.0 / factor if factor else np.inf]))
