"""Fits from nothing but rows, as a robot makes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.fit import Estimate, fit_state
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.row_buffer import RowBuffer
from coheft.estimation.moments.rows import ROW_SIZE
from coheft.estimation.moments.start import first_load, first_poses
from coheft.estimation.moments.unknowns import State, Unknowns
from coheft.estimation.rigid_body.mass_properties import PACKED_COLUMNS, PACKED_ROWS
from tests.estimation.moments.moving_team import NOISE, PERIOD, Team, extended_for, misread, noisy_for

IDEAL = FitSettings(NOISE, PERIOD)


@dataclass(frozen=True, eq=False)
class Fitted:
    """An estimate in the frame of the anchor, and what it was made of."""

    estimate: Estimate
    chapter: Chapter

    def error(self, truth: Team, anchor: int = 0) -> Array:
        """Step (u,) from the estimate to the true poses and load; sensors are exact."""
        state = truth.expressed_in(truth.poses[anchor]).state(self.estimate.body.unknowns.errors)
        return state.since(self.estimate.state, self.estimate.body.unknowns)


def buffer_of(rows: Array, settings: FitSettings, count: int, is_projected: bool = False) -> RowBuffer:
    buffer = RowBuffer(rows.shape[1], is_projected)
    add_rows(buffer, rows)
    assert count * settings.errors.row_size + 1 == rows.shape[1]
    return buffer


def add_rows(buffer: RowBuffer, rows: Array, first: int = 0) -> None:
    """Rows with consecutive numbers."""
    for number, row in enumerate(rows, first):
        buffer.add(number, row)


def poses_of(chapter: Chapter, settings: FitSettings, count: int, anchor: int = 0) -> State:
    """By motion alone, from far away."""
    kept, identity = chapter.buffer.moments_kept(), [Pose.identity()] * count
    state = State.first(identity, settings.errors)
    state = first_poses(kept, state, settings, np.arange(count) != anchor)
    guess = Guess.of(settings.body(state), kept)
    return fit_state(state, chapter.evaluation(), chapter.prior_evidence, guess, settings, anchor).state


def fit_from(state: State, chapter: Chapter, settings: FitSettings, anchor: int = 0) -> Fitted:
    """Of poses and load, from poses that are nearly right."""
    body, evaluate = settings.body(state), chapter.evaluation()
    guess = Guess.of(body, chapter.buffer.moments()[1])
    if state.load is None:
        state = first_load(state, evaluate(body).wrench, guess, settings)
    return Fitted(fit_state(state, evaluate, chapter.prior_evidence, guess, settings, anchor), chapter)


def fit(rows: Array, settings: FitSettings = IDEAL, anchor: int = 0, is_projected: bool = False) -> Fitted:
    """Of rows (n, 24 N + 1), or more with what follows them."""
    count = rows.shape[1] // settings.errors.row_size
    chapter = Chapter(buffer_of(rows, settings, count, is_projected), settings)
    state = poses_of(chapter, settings, count, anchor)
    if is_projected:
        chapter.buffer.project_at(settings.body(state))
    return fit_from(state, chapter, settings, anchor)


def normalised_error(error: Array, estimate: Estimate, settings: FitSettings, anchor: int = 0) -> float:
    """Mean of squared errors in standard deviations, over all unknowns that a fit moves: 1 on the average."""
    unknowns: Unknowns = estimate.body.unknowns
    free = settings.free(unknowns, anchor, with_load=True)
    covariance = estimate.covariance[np.ix_(free, free)]
    return float(error[free] @ np.linalg.solve(covariance, error[free])) / len(free)


def erring(team: Team, settings: FitSettings, rng: np.random.Generator) -> tuple[State, Array]:
    """The true state in the frame of the first robot, with random errors of sensors, and noisy rows as they read."""
    team, errors, count = team.expressed_in(team.poses[0]), settings.errors, team.count
    state, unknowns = team.state(errors), Unknowns(count, errors)
    step = np.zeros(unknowns.size)
    step[unknowns.eta] = errors.deviations * rng.normal(size=unknowns.eta.shape)
    step[unknowns.eta[0, [name == "clock" for name in errors.names]]] = 0.0
    gyros = settings.gyro_offset * rng.normal(size=(count, 3))
    offsets = rng.normal(size=(count, 6)) * np.repeat([settings.force_offset, settings.torque_offset], 3)
    step[unknowns.gyros] = np.mean([pose.rotation @ each for pose, each in zip(team.poses, gyros, strict=True)], axis=0)
    step[unknowns.offset] = np.sum([p.adjoint() @ each for p, each in zip(team.poses, offsets, strict=True)], axis=0)
    state = state.moved(step, unknowns, 6.0)
    exact = extended_for(errors, team.rows)
    rows = misread(exact, state) + noisy_for(errors, team, rng) - exact
    own = rows[:, : ROW_SIZE * count].reshape(len(rows), count, ROW_SIZE)
    own[..., 12:18] += offsets
    excess, w = gyros[None], own[..., :3].copy()
    own[..., :3] += excess
    mixed = w[..., PACKED_ROWS] * excess[..., PACKED_COLUMNS] + w[..., PACKED_COLUMNS] * excess[..., PACKED_ROWS]
    own[..., 18:] += mixed + excess[..., PACKED_ROWS] * excess[..., PACKED_COLUMNS]
    return state, rows
