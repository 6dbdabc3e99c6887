"""What is known of a team survives the way to a neighbour, and what cannot be right is not taken for knowledge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.agents.efficient.handover import decode, encode
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.moments.chapter import Prior
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import State, Unknowns
from tests.estimation.moments.fitting import IDEAL as MOVING
from tests.estimation.moments.fitting import fit
from tests.estimation.moments.moving_team import make_team
from tests.estimation.team import random_pose

TEAM, COUNT, ANCHOR = 9, 3, 1
SETTINGS = FitSettings(RowNoise.of_samples(SensorNoise(), 10, 500.0), 0.02, SensorErrors({"force_gain": 0.01}))

UNEQUAL = replace(
    SETTINGS, errors=SensorErrors(*({"force_gain": size, "torque_gain": 0.01} for size in (0.01, 0.0, 0.02)))
)
"""One robot's forces are exact."""
SCALE = 5 + 10 + COUNT * (Pose.SIZE + SETTINGS.errors.count) + 3 + 16
"""Where the scale of the first unknown is told."""


def some_prior(rng: np.random.Generator, errors: SensorErrors = SETTINGS.errors) -> Prior:
    unknowns = Unknowns(COUNT, errors)
    poses = [random_pose(rng) for _ in range(COUNT)]
    state = State.first(poses, errors).with_load(rng.normal(size=16))
    state = state.moved(0.01 * rng.normal(size=unknowns.size), unknowns, 6.0)
    root, noise = rng.normal(size=(2, unknowns.size, unknowns.size))
    root[:, unknowns.poses[2]] = noise[:, unknowns.poses[2]] = 0.0  # a robot of which nothing is known
    score = rng.normal(size=unknowns.size)
    score[unknowns.poses[2]] = 0.0
    evidence = Evidence.of_rows(score, 1e3 * root.T @ root, noise.T @ noise, 1e6)
    return Prior(state, Guess.about(np.arange(1.0, 11.0), 0.7), evidence, has_expectations=True, is_after_gap=True)


@pytest.mark.parametrize("settings", [SETTINGS, UNEQUAL], ids=["alike", "unequal"])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_told_is_heard(seed: int, settings: FitSettings) -> None:
    prior = some_prior(np.random.default_rng(seed), settings.errors)
    found = decode(encode(TEAM, prior, ANCHOR), TEAM, COUNT, settings)
    assert found is not None
    same, anchor = found
    assert anchor == ANCHOR
    assert (same.has_expectations, same.knows_load, same.is_after_gap) == (True, True, True)
    for name in ("score", "information", "noise", "doubt"):
        expected = getattr(prior.evidence, name)
        np.testing.assert_allclose(getattr(same.evidence, name), expected, atol=1e-9 * np.abs(expected).max())
    for left, right in zip(same.state.poses, prior.state.poses, strict=True):
        np.testing.assert_array_equal(left.numbers(), right.numbers())
    for name in ("eta", "gyros", "load"):
        np.testing.assert_allclose(getattr(same.state, name), getattr(prior.state, name), atol=1e-15)
    np.testing.assert_allclose(same.guess.limits, prior.guess.limits)


def test_nonsense_is_not_heard() -> None:
    prior = some_prior(np.random.default_rng(0))
    right = encode(TEAM, prior, ANCHOR)
    indefinite = replace(prior, evidence=replace(prior.evidence, noise=-prior.evidence.noise))
    bent = replace(prior.state, poses=(Pose(2.0 * np.eye(3), np.zeros(3)), *prior.state.poses[1:]))
    wrong: dict[str, Array] = {
        "another team": encode(TEAM + 1, prior, ANCHOR),
        "no such anchor": encode(TEAM, prior, COUNT),
        "too short": right[:-1],
        "single precision": right.astype(np.float32),
        "a pose that is none": encode(TEAM, replace(prior, state=bent), ANCHOR),
        "noise that is none": encode(TEAM, indefinite, ANCHOR),
        "a scale that is none": np.where(np.arange(len(right)) == SCALE, 1e-12, right),
        "no mass": encode(TEAM, replace(prior, guess=Guess.about(-np.ones(10), 0.7)), ANCHOR),
    }
    for what, numbers in wrong.items():
        assert decode(numbers, TEAM, COUNT, SETTINGS) is None, what


@pytest.mark.parametrize("gyro_offset", [0.0, 0.005])
def test_what_is_known_after_a_chapter_has_ended_is_heard(gyro_offset: float) -> None:
    settings = replace(MOVING, gyro_offset=gyro_offset)
    found = fit(make_team(3, count=4, number=150).noisy(np.random.default_rng(4)), settings)
    found.chapter.end(found.estimate, 148)
    assert found.chapter.prior is not None
    assert decode(encode(TEAM, found.chapter.prior, 0), TEAM, 4, settings) is not None
