"""Tests after a fit: whether all rows fit, and whether a faulty sensor would explain the wrenches as well as a load.

rows fit if no stretch of residuals and not the sum of their squares is larger than noise makes it
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from coheft.agents.efficient.innovations import Innovations
from coheft.agents.efficient.settings import Guards
from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import BodyModel
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.hidden_poses import best_residuals
from coheft.estimation.moments.misfit import KnownLoad, excess_energy, explanations, worst_misfit
from coheft.estimation.moments.misread import AXES, SCALE, UNITS, Misreading, WrenchFit
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.unknowns import OFFSET, THETA

_JUDGED = 256
"""Number of newest rows that are tested; older ones have been tested before."""
_READ_OTHERWISE = 64
"""Number of newest rows whose wrenches are tried otherwise: this takes about 1 ms for each robot of the team."""
_LEAST_REDUCTION = 0.1
"""A sensor error is judged if measurements have removed this share of its prior variance."""
_POSE, _MOTION, _LOAD = 6, 12, 10
"""Degrees of freedom that a fit takes from the residuals: for each pose, for each row's motion, for the load."""


class Outcome(Enum):
    """Outcome of the tests after a fit; values are reasons in words."""

    FITS = "all rows fit"
    NO_BODY = "motions do not fit one rigid body: a sensor may be off"
    BEYOND_TOLERANCE = "sensors are off by more than their tolerances say"
    NO_LOAD = "wrenches fit no load: a force or torque sensor may be off"
    UNDECIDED = "either the load has changed or a sensor has an offset"


@dataclass(frozen=True)
class Verdict:
    """Outcome of the tests after a fit.

    Attributes:
        outcome: The outcome.
        rival: If undecided, index of the robot (None if any) and sensor that would explain the wrenches as well.
        robot: Index of the robot that fits worst, if one stands out.
        misreading: If wrenches fit no load, what would make them fit, if known.
    """

    outcome: Outcome
    rival: tuple[int | None, str] | None = None
    robot: int | None = None
    misreading: Misreading | None = None


def judge(
    estimate: Estimate,
    innovations: Innovations,
    buffer: RowBuffer,
    guards: Guards,
    settings: FitSettings,
    drift: Array,
    load_before: KnownLoad | None = None,
) -> Verdict:
    """Judge a fit by its residuals.

    Motion sensors may have drifted by the variance ``drift`` (N, 12) or (1, 12), in units of the noise. ``load_before``
    is the load before the last change, while a faulty sensor may still explain that change; else None.
    """
    assumed = KnownLoad(estimate.state.fitted_load) if load_before is None else load_before
    first = max(0, buffer.count - _JUDGED)
    wrench, motion = innovations.residuals(buffer.rows[first : buffer.count])
    wrench, body = wrench[max(0, buffer.start - first) :], estimate.body
    freedom = len(motion) * (int(np.count_nonzero(body.weight)) - _MOTION) - _POSE * (body.count - 1)
    if not _fits(motion, freedom, guards, drift):
        worst = worst_misfit(motion, drift)
        return Verdict(Outcome.NO_BODY, robot=None if worst is None else worst.source)
    if (robot := _robot_beyond_tolerance(estimate, guards)) is not None:
        return Verdict(Outcome.BEYOND_TOLERANCE, robot=robot)
    if not _fits(wrench, wrench.size - _LOAD, guards):
        if not estimate.misses_poses:
            return Verdict(Outcome.NO_LOAD)
        best, moved = best_residuals(estimate, settings, buffer.rows[max(first, buffer.start) : buffer.count])
        if not _fits(best, best.size - _LOAD, guards, moved=moved):
            return Verdict(Outcome.NO_LOAD)
    found = explanations(body, innovations.gram(), assumed)
    is_load = found.load > found.sensor and _has_another_mass(estimate, assumed, guards)
    if load_before is None or found.sensor < chi_square_threshold(3, guards.offset) - 3.0 or is_load:
        is_beyond = _has_offset_beyond_tolerance(estimate, settings, guards)
        return Verdict(Outcome.BEYOND_TOLERANCE if is_beyond else Outcome.FITS)
    # Where torques are all measured about points of one body, it makes no difference whose torque sensor is off.
    return Verdict(Outcome.UNDECIDED, (found.robot if found.kind == "force" else None, found.kind))


def misreading(body: BodyModel, extended_rows: Array, guards: Guards) -> Misreading | None:
    """Return the only thing that would make wrenches fit a load, or None; see ``WrenchFit`` for the arguments.

    If the others' wrenches fit a load by themselves, a robot's factor means nothing.
    """

    def fitting(found: Iterable[Misreading]) -> list[Misreading]:
        return [each for each in found if _fits(each.residuals, each.freedom, guards)]

    wrenches = WrenchFit(body, extended_rows[-_READ_OTHERWISE:])
    for found in (wrenches.as_read(), wrenches.untared(), *map(wrenches.misreadings, (SCALE, UNITS, AXES))):
        match fitting(found):
            case []:
                continue
            case [only] if only.words and (only.robot is None or not fitting(wrenches.without(only.robot))):
                return only
        return None
    return None


def _has_another_mass(estimate: Estimate, load_before: KnownLoad, guards: Guards) -> bool:
    """Whether the mass has changed: a load that only shifts is rarer than a faulty torque sensor."""
    if load_before.covariance is None:
        return True
    load = estimate.state.fitted_load
    variance = estimate.variance_of_mass + load_before.covariance[-10, -10]
    return bool((load[THETA] - load_before.load[THETA])[0] ** 2 > chi_square_threshold(1, guards.mass) * variance)


def _robot_beyond_tolerance(estimate: Estimate, guards: Guards) -> int | None:
    """Return a robot whose sensor errors exceed their tolerances, or None.

    Found errors in prior deviations are ``h ~ N(0, 1 - P)`` where ``P`` is their posterior covariance: along each
    direction that has been observed, ``h^2 / (1 - P)`` is chi-square.
    """
    unknowns = estimate.body.unknowns
    for robot, every in enumerate(unknowns.deviations):
        is_declared = every > 0.0
        if not is_declared.any():
            continue
        deviations, indices = every[is_declared], unknowns.eta[robot, is_declared]
        uncertain = estimate.covariance[np.ix_(indices, indices)] / np.outer(deviations, deviations)
        if _is_beyond(estimate.state.eta[robot, is_declared] / deviations, uncertain, guards):
            return robot
    return None


def _has_offset_beyond_tolerance(estimate: Estimate, settings: FitSettings, guards: Guards) -> bool:
    """Whether the offset of the total wrench exceeds what tolerances allow; offsets that drift are not judged."""
    load, offset = estimate.state.fitted_load, estimate.body.unknowns.offset
    if not settings.has_offset or max(settings.drift.force, settings.drift.torque) > 0.0:
        return False
    root = np.linalg.cholesky(settings.offset_covariance(estimate.body))
    uncertain = np.linalg.solve(root, np.linalg.solve(root, estimate.covariance[offset, offset]).T)
    return _is_beyond(np.linalg.solve(root, load[OFFSET]), uncertain, guards)


def _is_beyond(found: Array, uncertain: Array, guards: Guards) -> bool:
    """Whether errors (k,) with posterior covariance (k, k), in prior deviations, are too large."""
    seen, directions = np.linalg.eigh(np.eye(len(found)) - uncertain)
    is_seen = seen > _LEAST_REDUCTION
    square = np.square(found @ directions[:, is_seen]) / seen[is_seen]
    return bool(is_seen.any() and square.sum() > chi_square_threshold(int(is_seen.sum()), guards.tolerance))


def _fits(
    residuals: Array,
    freedom: float,
    guards: Guards,
    drift: Array | float = 0.0,
    moved: Sequence[float] | Array = (),
) -> bool:
    """Whether residuals (n, s, d), and a step (k,), in standard deviations, are no larger than noise explains."""
    worst = worst_misfit(residuals, drift)
    if worst is not None and worst.chi_square > chi_square_threshold(residuals.shape[2], guards.misfit):
        return False
    scaled = np.append(residuals / np.sqrt(1.0 + drift), moved)
    return excess_energy(scaled, np.maximum(freedom, 1.0), guards.noise_tolerance) <= guards.energy
