"""Sessions that are fed with made-up rows, and how far they are off."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import numpy as np

from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards
from coheft.agents.efficient.stages import Stage
from coheft.estimation.geometry.spatial import Array, Pose, rotation_exp, rotation_log
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows

BEFORE, AFTER = 150, 200


def slipped_poses(millimetres: float, degrees: float, robot: int, seed: int) -> tuple[Pose, ...]:
    """Poses after a slip in a random direction."""
    rng = np.random.default_rng(seed)
    shift, turn = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    poses = list(POSES)
    poses[robot] = poses[robot] @ Pose(rotation_exp(np.radians(degrees) * turn), 1e-3 * millimetres * shift)
    return tuple(poses)


def slipped(millimetres: float, degrees: float, robot: int, seed: int) -> tuple[Array, tuple[Pose, ...]]:
    """Rows over a slip in a random direction, and the poses after it."""
    poses = slipped_poses(millimetres, degrees, robot, seed)
    rows = [made_up_rows(BEFORE, seed=seed), made_up_rows(AFTER, first=BEFORE, seed=seed, poses=poses)]
    return np.concatenate(rows), poses


def session(guards: Guards | None = None, own: int = 0) -> Session:
    settings = FitSettings(RowNoise.of_samples(SensorNoise(), 20, 1000.0), PERIOD)
    return Session(len(POSES), own, settings, Guards() if guards is None else guards)


def fed(rows: Array, guards: Guards | None = None) -> Session:
    found = session(guards)
    for number, row in enumerate(rows):
        found.take(number, row)
    return found


@cache
def _first_rows_taken() -> Session:
    return fed(made_up_rows(BEFORE))


def before() -> Session:
    """A session that has taken the first rows; these are fitted once for all tests.

    A test that replaces parts of sessions which matter for these rows feeds its own one.
    """
    return deepcopy(_first_rows_taken())


def is_valid(found: Session) -> bool:
    is_clear = found.contradicting is None and not found.causes.is_open
    return found.stage is Stage.ESTIMATING and is_clear and found.is_confirmed


def largest_error(found: Session, poses: tuple[Pose, ...], mass: float = LOAD[0]) -> float:
    """Of poses and mass, in the robot's own standard deviations."""
    assert found.estimate is not None
    state, unknowns = found.estimate.state, found.estimate.body.unknowns
    deviations = np.sqrt(found.estimate.covariance.diagonal())
    anchor = int(np.argmin(deviations[unknowns.poses].max(axis=1)))
    to_state = state.poses[anchor] @ poses[anchor].inverse()
    errors = list[float]()
    for robot, pose in enumerate(poses):
        true, own = to_state @ pose, unknowns.poses[robot]
        error = [
            *rotation_log(true.rotation @ state.poses[robot].rotation.T),
            *(true.translation - state.poses[robot].translation),
        ]
        errors += [] if robot == anchor else np.abs(error / deviations[own]).tolist()
    assert state.load is not None
    mass_error = abs(state.load[6] - mass) / deviations[unknowns.theta.start]
    return float(max(*errors, mass_error))
