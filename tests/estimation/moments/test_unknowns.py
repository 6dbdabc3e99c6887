"""Unknowns: each has a place of its own, and a state moves along all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coheft.estimation.geometry.body_motion import perturbation_between, perturbed
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.unknowns import LOAD_SIZE, OFFSET, THETA, State, Unknowns
from tests.estimation.moments.moving_team import ERRORS, EVERY, EXACT, LATE, make_team

FAR = 1e9


def moved_state(errors: SensorErrors, seed: int, size: float) -> tuple[State, State, Unknowns, Array]:
    """A state far from exact sensors, the same after a step, and the step."""
    rng, state, unknowns = np.random.default_rng(seed), make_team(seed=1).state(errors), Unknowns(3, errors)
    state = state.moved(0.05 * rng.normal(size=unknowns.size), unknowns, FAR)
    step = size * rng.normal(size=unknowns.size)
    return state, state.moved(step, unknowns, FAR), unknowns, step


@given(st.integers(1, 9), st.sampled_from([EXACT, ERRORS, LATE]))
def test_places_are_a_partition(count: int, errors: SensorErrors) -> None:
    unknowns = Unknowns(count, errors)
    everything = np.arange(unknowns.size)
    robots = np.concatenate([unknowns.of_robot(robot) for robot in range(count)])
    common = [everything[part] for part in (unknowns.gyros, unknowns.offset, unknowns.theta)]
    np.testing.assert_array_equal(np.concatenate([robots, *common]), everything)
    np.testing.assert_array_equal(unknowns.common, np.concatenate(common))
    np.testing.assert_array_equal(np.hstack([unknowns.poses, unknowns.eta]).ravel(), robots)
    np.testing.assert_array_equal(everything[unknowns.load], np.concatenate(common[1:]))
    assert [len(part) for part in common] == [3, 6, 10]
    assert unknowns.eta.shape == (count, errors.count)
    assert unknowns.motion_size == unknowns.load.start
    np.testing.assert_array_equal(everything[unknowns.load][OFFSET], everything[unknowns.offset])
    np.testing.assert_array_equal(everything[unknowns.load][THETA], everything[unknowns.theta])


@EVERY
def test_a_step_moves_what_it_names(errors: SensorErrors) -> None:
    before, after, unknowns, step = moved_state(errors, seed=2, size=0.1)
    for i, (old, new) in enumerate(zip(before.poses, after.poses, strict=True)):
        np.testing.assert_allclose(perturbed(old, step[unknowns.poses[i]]).numbers(), new.numbers(), atol=1e-12)
    np.testing.assert_allclose(after.eta - before.eta, step[unknowns.eta], atol=1e-12)
    np.testing.assert_allclose(after.gyros - before.gyros, step[unknowns.gyros], atol=1e-12)
    assert before.load is not None
    assert after.load is not None
    np.testing.assert_allclose(after.load - before.load, step[unknowns.load], atol=1e-12)
    if before.calibration is not None:
        assert after.calibration is not None
        np.testing.assert_allclose(after.calibration, errors.step(step[unknowns.eta]) @ before.calibration, atol=1e-12)


@EVERY
def test_since_is_the_step_that_was_taken(errors: SensorErrors) -> None:
    before, after, unknowns, step = moved_state(errors, seed=3, size=0.1)
    np.testing.assert_allclose(after.since(before, unknowns), step, atol=1e-9)
    np.testing.assert_array_equal(before.since(before, unknowns), 0.0)


@EVERY
def test_two_steps_add_up_to_first_order(errors: SensorErrors) -> None:
    before, _, unknowns, step = moved_state(errors, seed=4, size=0.1)
    other = 0.1 * np.random.default_rng(5).normal(size=unknowns.size)

    def missing(size: float) -> float:
        twice = before.moved(size * step, unknowns, FAR).moved(size * other, unknowns, FAR)
        return float(np.abs(twice.since(before, unknowns) - size * (step + other)).max())

    assert missing(1.0) / missing(0.5) == pytest.approx(4.0, rel=0.3)


@pytest.mark.parametrize("errors", [ERRORS, LATE], ids=["errors", "late"])
def test_no_error_of_a_sensor_goes_too_far(errors: SensorErrors) -> None:
    unknowns, state = Unknowns(3, errors), make_team(seed=1).state(errors)
    step = np.zeros(unknowns.size)
    step[unknowns.eta] = 10.0 * errors.deviations * np.array([[1.0], [-1.0], [0.1]])
    far = state.moved(step, unknowns, farthest=6.0)
    expected = errors.deviations * np.array([[6.0], [-6.0], [1.0]])
    np.testing.assert_allclose(far.eta, expected)
    np.testing.assert_allclose(far.calibration, errors.step(expected), atol=1e-15)
    again = far.moved(step, unknowns, farthest=6.0)
    np.testing.assert_allclose(again.eta[:2], expected[:2])
    assert again.calibration is not None
    np.testing.assert_allclose(again.calibration[:2], errors.step(expected)[:2], atol=1e-15)


@EVERY
def test_a_state_begins_with_exact_sensors_and_without_a_load(errors: SensorErrors) -> None:
    team, unknowns = make_team(seed=1), Unknowns(3, errors)
    state = State.first(team.poses, errors)
    assert state.load is None
    assert not state.eta.any()
    assert not state.gyros.any()
    assert (state.calibration is None) == (errors.count == 0)
    if state.calibration is not None:
        np.testing.assert_array_equal(state.calibration, np.broadcast_to(np.eye(errors.width), state.calibration.shape))
    assert state.moved(np.ones(unknowns.size), unknowns, FAR).load is None
    with_load = state.with_load(np.ones(LOAD_SIZE))
    assert not state.since(with_load, unknowns).any()
    assert not with_load.since(state, unknowns).any()
    assert with_load.with_load(None).load is None


def test_perturbations_of_poses_are_in_the_axes_of_the_body_frame() -> None:
    before, after, unknowns, _ = moved_state(EXACT, seed=6, size=0.1)
    step = after.since(before, unknowns)
    expected = [perturbation_between(old, new) for old, new in zip(before.poses, after.poses, strict=True)]
    np.testing.assert_allclose(step[unknowns.poses], expected, atol=1e-12)
