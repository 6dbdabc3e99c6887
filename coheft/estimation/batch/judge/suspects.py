"""What may be wrong with the forces of a recording, one cause at a time, each fitted along with the load.

A cause adds columns to the total wrench, or makes another wrench or another motion of it. What it gains is a likelihood
ratio; what it costs grows with its unknowns, and with the number of robots that it could have been.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from scipy.special import expit

from coheft.estimation.batch.body import regressor, total_wrench
from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.turned import fit_turned
from coheft.estimation.batch.judge.wrench_misfit import BODY_NUMBERS, REWEIGHTINGS, Fit, WrenchMisfit
from coheft.estimation.geometry.body_motion import BODY_A
from coheft.estimation.geometry.spatial import Array, skew

_STEP = 0.06
"""A load changes within some of these [s]."""
_LONGEST_DELAY, _DELAY_STEP, _DELAY_FOUND = 0.5, 0.05, 2e-4
_TURNS = 8
_TURNED = 1e-6


@dataclass(frozen=True, eq=False)
class Suspect:
    """One cause, fitted.

    Attributes:
        cause: Which.
        robot: Whose; None: of all alike, or of no robot in particular.
        fit: With it.
        gain: Twice the log likelihood ratio to no cause, less what the cause's unknowns cost.
        value: Its unknowns: an offset (6,) in the body frame, a lever (3,) [m], a factor, a delay [s], gravity (3,),
            a sensor's axes (9,), or an offset and its drift per minute (12,).
        time: When it happened [s]; None if all the time.
    """

    cause: Cause
    robot: int | None
    fit: Fit
    gain: float
    value: Array = field(default_factory=lambda: np.zeros(0))
    time: float | None = None


class Suspects:
    """All causes, side by side."""

    def __init__(self, misfit: WrenchMisfit, homes: Array, gravity: Array) -> None:
        """Prepare.

        Args:
            misfit: Of the recording.
            homes: Rotations of all robots' home frames in the first one's, as poses have them, shape (N, 3, 3); none
                without poses.
            gravity: In each home frame (3,) [m/s²].
        """
        self._misfit, self._homes, self._gravity = misfit, homes, gravity
        self._count = len(misfit.adjoints)
        if misfit.signals.rotation is not None:
            rotations = [self._body_rotations(robot) for robot in range(self._count)]
            self._rotations = rotations[0]
            self._supposed = np.mean([gravity @ own for own in rotations], axis=0)
            """Gravity in the body frame (n, 3), as the motion has it: the mean of what robots take for it."""
        self._per_unknown = float(np.log(misfit.plain.residual.size))
        self._whose = 2.0 * float(np.log(self._count))

    def all(self) -> list[Suspect]:
        """From the likeliest to the least likely."""
        found = [*self._offset(), *self._levers(), *self._scales(), *self._clocks(), *self._turned(), *self._changes()]
        if self._misfit.signals.rotation is not None:
            found += [*self._axes(), self._no_weight(), self.direction_of_gravity()]
        return sorted(found, key=lambda suspect: -suspect.gain)

    def _suspect(self, cause: Cause, robot: int | None, fit: Fit, unknowns: int, value: Array | None = None) -> Suspect:
        cost = unknowns * self._per_unknown + (self._whose if robot is not None else 0.0)
        # No cause is one that needs a load without mass.
        gain = self._misfit.plain.misfit - fit.misfit - cost if fit.solution[0] > 0.0 else -np.inf
        return Suspect(cause, robot, fit, gain, fit.solution[BODY_NUMBERS:] if value is None else value)

    def _offset(self) -> Iterator[Suspect]:
        """A constant wrench, or one that drifts; in whose sensor it is, the total does not tell."""
        columns = np.broadcast_to(np.eye(6), (len(self._misfit.total), 6, 6))
        yield self._suspect(Cause.OFFSET, None, self._misfit.fit(columns), 6)
        minutes = (self._misfit.signals.time / 60.0)[:, None, None]
        yield self._suspect(
            Cause.DRIFT, None, self._misfit.fit(np.concatenate([columns, minutes * columns], axis=-1)), 12
        )

    def _levers(self) -> Iterator[Suspect]:
        """Moments that are about another point: ``t + l x f``."""
        maps = [np.block([[np.zeros((3, 6))], [skew(axis), np.zeros((3, 3))]]) for axis in np.eye(3)]
        columns = [self._read_through(robot, maps) for robot in range(self._count)]
        for robot, own in enumerate(columns):
            yield self._suspect(Cause.LEVER, robot, self._misfit.fit(own, [(robot, maps)]), 3)
        fit = self._misfit.fit(np.sum(columns, axis=0), [(robot, maps) for robot in range(self._count)])
        yield self._suspect(Cause.LEVER, None, fit, 3)

    def _scales(self) -> Iterator[Suspect]:
        """Readings that are too large or too small, by a factor: all six, forces alone, moments alone."""
        forces, moments = np.diag([1.0, 1, 1, 0, 0, 0]), np.diag([0.0, 0, 0, 1, 1, 1])
        for cause, scaled in ((Cause.SCALE, np.eye(6)), (Cause.FORCE_SCALE, forces), (Cause.MOMENT_SCALE, moments)):
            columns = [self._read_through(robot, [scaled]) for robot in range(self._count)]
            for robot, own in enumerate(columns):
                yield self._scaled(cause, robot, self._misfit.fit(own, [(robot, [scaled])]))
        every = [(robot, [moments]) for robot in range(self._count)]
        yield self._scaled(Cause.MOMENT_SCALE, None, self._misfit.fit(np.sum(columns, axis=0), every))

    def _scaled(self, cause: Cause, robot: int | None, fit: Fit) -> Suspect:
        """Of a reading ``x`` it is ``(1 - b) x`` that belongs to the load."""
        right = 1.0 - float(fit.solution[BODY_NUMBERS])
        return self._suspect(cause, robot, fit, 1, np.array([1.0 / right if abs(right) > 1e-6 else np.inf]))

    def _read_through(self, robot: int, maps: list[Array]) -> Array:
        """Columns (n, 6, q) of one robot's readings, multiplied by each map, in the body frame."""
        own, to_body = self._misfit.wrenches[robot], self._misfit.adjoints[robot]
        return np.stack([own @ (to_body @ one).T for one in maps], axis=-1)

    def _clocks(self) -> Iterator[Suspect]:
        """Wrenches that come late, of one robot or of all."""
        for robots in (*([robot] for robot in range(self._count)), list(range(self._count))):
            delay, fit = self._delay_of(robots)
            yield self._suspect(Cause.CLOCK, robots[0] if len(robots) == 1 else None, fit, 1, np.array([delay]))

    def _delay_of(self, robots: list[int]) -> tuple[float, Fit]:
        time = self._misfit.signals.time
        splines = {robot: CubicSpline(time, self._misfit.wrenches[robot]) for robot in robots}
        delay = 0.0
        for _ in range(_TURNS):
            at = np.clip(time + delay, time[0], time[-1])
            moved = self._misfit.wrenches.copy()
            column = np.zeros((len(time), 6, 1))
            for robot, spline in splines.items():
                moved[robot] = spline(at)
                column[..., 0] -= spline(at, 1) @ self._misfit.adjoints[robot].T
            fit = self._misfit.fit(column, total=total_wrench(moved, self._misfit.poses))
            step = float(np.clip(fit.solution[BODY_NUMBERS], -_DELAY_STEP, _DELAY_STEP))
            delay = float(np.clip(delay + step, -_LONGEST_DELAY, _LONGEST_DELAY))
            if abs(step) < _DELAY_FOUND:
                break
        return delay, fit

    def _axes(self) -> Iterator[Suspect]:
        """Wrenches in the axes of the home frame instead of the grasp frame's."""
        rotation = self._misfit.signals.rotation
        assert rotation is not None
        halves = self._misfit.wrenches.reshape(*self._misfit.wrenches.shape[:2], 2, 3)
        turned = np.einsum("knji,knhj->knhi", rotation, halves).reshape(self._misfit.wrenches.shape)
        for robot in range(self._count):
            wrenches = self._misfit.wrenches.copy()
            wrenches[robot] = turned[robot]
            fit = self._misfit.fit(total=total_wrench(wrenches, self._misfit.poses))
            yield self._suspect(Cause.BASE_AXES, robot, fit, 1)
        yield self._suspect(Cause.BASE_AXES, None, self._misfit.fit(total=total_wrench(turned, self._misfit.poses)), 1)

    def _turned(self) -> Iterator[Suspect]:
        """Sensors whose axes are turned or exchanged."""
        for robots in (*([robot] for robot in range(self._count)), list(range(self._count))):
            axes, fit = fit_turned(self._misfit, robots)
            robot = robots[0] if len(robots) == 1 else None
            yield self._suspect(Cause.TURNED, robot, fit, 3, axes.ravel())

    def _no_weight(self) -> Suspect:
        """Forces from which a controller has taken the weight away."""
        return self._suspect(Cause.COMPENSATED, None, self._misfit.fit(regressor=self._regressor(np.zeros(3))), 1)

    def _regressor(self, gravity: Array) -> Array:
        """Of the body (n, 6, 10), if gravity (3,) were this one in the first robot's home frame."""
        motion = self._misfit.motion.copy()
        motion[:, BODY_A] += self._supposed - gravity @ self._rotations
        return regressor(motion)

    def _body_rotations(self, robot: int) -> Array:
        """Of the body frame in a robot's home frame, (n, 3, 3)."""
        rotation = self._misfit.signals.rotation
        assert rotation is not None
        result: Array = rotation[robot] @ self._misfit.poses[robot].rotation.T
        return result

    def direction_of_gravity(self) -> Suspect:
        """Gravity as forces have it, in the first robot's home frame."""
        size = float(np.linalg.norm(self._gravity))
        mean = np.mean(self._homes @ self._gravity, axis=0)
        mean *= size / max(float(np.linalg.norm(mean)), 1e-9)
        others = [*(self._homes @ self._gravity), *(size * np.vstack([np.eye(3), -np.eye(3)]))]
        rough = sorted(others, key=lambda start: self._misfit.fit(regressor=self._regressor(start)).misfit)
        best = min((self._tilted(start) for start in (mean, *rough[:2])), key=lambda found: found[1].misfit)
        return self._suspect(Cause.GRAVITY, None, best[1], 2, best[0])

    def _tilted(self, gravity: Array) -> tuple[Array, Fit]:
        """The direction nearby that fits best, by Gauss-Newton, and the fit with it."""
        for _ in range(_TURNS):
            basis = np.linalg.svd(gravity[None])[2][1:]
            body = self._misfit.fit(regressor=self._regressor(gravity)).solution
            pulls = np.stack([-np.cross(axis, gravity) @ self._rotations for axis in basis], axis=-1)
            columns = np.concatenate([body[0] * pulls, np.cross(body[1:4], pulls, axisb=1, axisc=1)], axis=1)
            fit = self._misfit.fit(columns, regressor=self._regressor(gravity))
            turn = np.clip(fit.solution[BODY_NUMBERS:], -0.5, 0.5)
            if np.abs(turn).max() < _TURNED:
                break
            gravity = Rotation.from_rotvec(turn @ basis).apply(gravity)
        return gravity, fit

    def _changes(self) -> Iterator[Suspect]:
        """Another load, or another zero of some sensor, from some time on."""
        zero = np.broadcast_to(np.eye(6), (len(self._misfit.total), 6, 6))
        for cause, columns in ((Cause.LOAD_CHANGE, self._misfit.regressor), (Cause.OFFSET_JUMP, zero)):
            time = self._misfit.signals.time
            tried = np.arange(time[0] + 1.0, time[-1] - 1.0, 1.0)
            if not len(tried):
                return
            least, when = min((self._from(at, columns, passes=1).misfit, at) for at in tried)
            for step in (0.5, 0.25, 0.12, 0.06, 0.03):
                for at in np.clip((when - step, when + step), tried[0], tried[-1]):  # not what filters do at the ends
                    misfit = self._from(at, columns, passes=1).misfit
                    if misfit < least:
                        least, when = misfit, at
            best = self._from(when, columns)
            found = self._suspect(cause, None, best, columns.shape[-1])
            gain = found.gain - 2.0 * float(np.log(len(tried)))
            yield Suspect(cause, None, best, gain, found.value, float(when))

    def _from(self, time: float, columns: Array, passes: int = REWEIGHTINGS) -> Fit:
        later = expit((self._misfit.signals.time - time) / _STEP)
        return self._misfit.fit(columns * later[:, None, None], passes=passes)


def forces_instead(moments: Suspect) -> Suspect:
    """All forces too small, where all moments are too large: the same to any motion, but of another load."""
    factor = float(moments.value[0])
    body = moments.fit.solution[:BODY_NUMBERS]
    by_factor = np.column_stack([factor * np.eye(BODY_NUMBERS), factor**2 * body])
    fit = replace(moments.fit, solution=factor * body, covariance=by_factor @ moments.fit.covariance @ by_factor.T)
    gain = moments.gain if 0.0 < factor < np.inf else -np.inf
    return Suspect(Cause.FORCE_SCALE, None, fit, gain, np.array([1.0 / factor if factor else np.inf]))
