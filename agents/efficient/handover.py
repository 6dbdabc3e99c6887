"""Handover of the estimate of the team to a neighbour that has just started, as one quadratic.

    known = (head, theta, poses, errors, gyro offset, load, scale s, s score, s information s, s noise s)

It is sent as one array of numbers; of the scaled symmetric matrices only the upper half is sent.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.unknowns import LOAD_SIZE, State, Unknowns

CHANNEL = "known"
_HEAD = 5  # number of the team, index of the anchor, size of the load, ``has_expectations``, ``is_after_gap``
_MANY_ROWS = 1e6
"""The message does not say how many rows the evidence is from; its noise is known as well as that of so many."""
_LEAST_SCALE, _ROUNDING = 1e-10, 1e-6
"""Smaller scales are refused, except 0; those of offsets that are exact are not. Matrices are positive semidefinite up
to this share of their diagonal."""


def encode(team: int, prior: Prior, anchor: int) -> Array:
    """Encode the prior and anchor with which this robot's session has begun."""
    state, guess, evidence = prior.state, prior.guess, prior.evidence
    information = evidence.information.diagonal()
    scale = np.where(information > 0.0, 1.0 / np.sqrt(np.maximum(information, 1e-300)), 0.0)
    half = np.triu_indices(len(scale))
    return np.concatenate(
        [
            [team, anchor, guess.size, prior.has_expectations, prior.is_after_gap],
            guess.theta,
            *(pose.numbers() for pose in state.poses),
            state.eta.ravel(),
            state.gyros,
            state.fitted_load,
            scale,
            scale * evidence.score,
            *((np.outer(scale, scale) * each)[half] for each in (evidence.information, evidence.noise)),
        ]
    )


def decode(numbers: npt.NDArray[Any], team: int, count: int, settings: FitSettings) -> tuple[Prior, int] | None:
    """Decode a prior and the index of the anchor from finite numbers; None if these cannot be right for a team of this
    number, with ``count`` robots and these settings of fits.
    """
    unknowns, errors = Unknowns(count, settings.errors), settings.errors
    size, half = unknowns.size, unknowns.size * (unknowns.size + 1) // 2
    sizes = [_HEAD, 10, Pose.SIZE * count, errors.count * count, 3, LOAD_SIZE, size, size, half, half]
    if numbers.dtype != np.float64 or numbers.shape != (sum(sizes),):
        return None
    head, theta, poses, eta, gyros, load, scale, score, *matrices = np.split(numbers, np.cumsum(sizes[:-1]))
    anchor, all_poses = int(head[1]), [Pose.of_numbers(each) for each in poses.reshape(count, -1)]
    is_right = head[0] == team and 0 <= anchor < count and head[2] > 0.0 and theta[0] > 0.0
    if not is_right or not all(pose.is_rigid() for pose in all_poses):
        return None
    information, noise = (_whole(matrix, size) for matrix in matrices)
    is_scaled = scale > _LEAST_SCALE
    sums = (noise, information + noise)  # the information alone is free of noise, so it may be a little indefinite
    if not (is_scaled | (scale == 0.0)).all() or any(np.linalg.eigvalsh(each)[0] < -_ROUNDING for each in sums):
        return None
    unit = np.divide(1.0, scale, out=np.zeros(size), where=is_scaled)
    information, noise = (matrix * np.outer(unit, unit) for matrix in (information, noise))
    all_eta = eta.reshape(count, -1)
    state = State(tuple(all_poses), all_eta, errors.step(all_eta) if errors.count else None, gyros, load)
    evidence = Evidence.of_rows(unit * score, information, noise, _MANY_ROWS)
    guess = Guess.about(theta, float(head[2]))
    return Prior(state, guess, evidence, bool(head[3]), is_after_gap=bool(head[4])), anchor


def _whole(half: Array, size: int) -> Array:
    """Return the symmetric matrix with this upper half."""
    matrix = np.zeros((size, size))
    matrix[np.triu_indices(size)] = half
    return matrix + np.triu(matrix, 1).T
