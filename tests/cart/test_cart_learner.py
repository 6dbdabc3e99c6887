"""What is found out about a cart, and whether what is said of it can be believed."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from msgspec import structs
from scipy.optimize import brentq
from scipy.special import chdtri

from coheft.agents.cart.agent import CartAgent
from coheft.app.cart.inprocess import CartRun, run_in_process
from coheft.app.cart.table_one import table_one
from coheft.estimation.cart.filter import (
    INNOVATION_SIZE,
    Belief,
    MotionMeasurement,
    Prediction,
    Push,
    Update,
    move,
    predict,
    smooth,
    update,
)
from coheft.estimation.cart.jump import FALSE_ALARMS
from coheft.estimation.cart.learner import CartLearner
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.observability import QUANTITIES, not_known
from coheft.estimation.cart.prior import CartPrior, nearest_possible
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.cart.physics import CartSimulation
from coheft.wire.cart.config import agent_config
from coheft.wire.cart.messages import CartMeasurement, CartPush
from coheft.wire.cart.scenario import CartLoad, CartScenario

PERIOD = 0.01

pytestmark = pytest.mark.timeout(600)


@cache
def run(test: int, seed: int, duration: float = 30.0, friction_guess: float | None = None) -> CartRun:
    scenario = table_one(test, seed=seed, friction_guess=friction_guess)
    return run_in_process(structs.replace(scenario, duration=duration))


def errors_in_deviations(found: CartRun) -> Array:
    """Errors of ``(m, d_x, d_y, I)`` at the end, whitened, shape (4,)."""
    last, truth = found.estimates["p1"][-1], found.truths[-1].cart
    error = np.array([last.cart.mass, *last.cart.com, last.cart.inertia])
    error -= [truth.mass, *truth.com, truth.inertia]
    whitened: Array = np.linalg.solve(np.linalg.cholesky(last.covariance[:4, :4]), error)
    return whitened


@pytest.mark.slow
def test_errors_are_as_large_as_it_says_and_an_unchanged_cart_is_not_taken_for_another() -> None:
    """Over three runs the normalised errors squared add up to a chi-square variable."""
    found = [run(5, seed, 13.0) for seed in range(1, 4)]
    assert all(each.estimates["p1"][-1].jumps == 0 for each in found)
    total = sum(float(np.sum(errors_in_deviations(each) ** 2)) for each in found)
    assert chdtri(12, 1.0 - 1e-4) < total < chdtri(12, 1e-4)


@pytest.mark.slow
def test_covariances_stay_what_they_are() -> None:
    for estimate in run(11, 1).estimates["p1"]:
        np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, atol=1e-12)
        scale = np.sqrt(np.diag(estimate.covariance)[:4])
        assert np.linalg.eigvalsh(estimate.covariance[:4, :4] / np.outer(scale, scale)).min() > 0.0


@pytest.mark.slow
def test_friction_that_is_guessed_wrong_by_a_factor_of_two_costs_little() -> None:
    for factor in (0.5, 2.0):
        estimates = run(5, 1, 11.0, factor).estimates["p1"]
        at_ten = next(e for e in estimates if e.time >= 10.0)
        assert abs(at_ten.cart.mass - 20.0) < 0.1
        assert estimates[-1].cart.friction[0] == pytest.approx(5.0, abs=0.05)


def test_on_a_straight_line_it_says_what_it_cannot_know() -> None:
    straight, curves = run(1, 1, 6.0).estimates["p1"][-1], run(5, 1, 13.0).estimates["p1"][-1]
    assert "drive a curve" in straight.not_known["d_x"]
    assert not {"mass", "d_y"} & straight.not_known.keys()
    assert not curves.not_known
    assert curves.jumps == 0


def test_before_the_first_push_nothing_is_known() -> None:
    prior = CartPrior()
    guess = CartBody(16.0, (0.3, 0.0), 1.8, (5.0, 5.0))
    learner = CartLearner(guess, MotionMeasurement(np.zeros(6), 2.5e-5 * np.eye(6)), prior)
    assert set(not_known(learner.body_covariance())) == set(QUANTITIES)
    deviations = np.sqrt(np.diag(learner.body_covariance()))
    np.testing.assert_allclose(deviations, [9.6, 0.15, 0.15, 1.08, 5.0, 5.0], rtol=1e-9)


def test_nothing_is_learned_from_a_cart_that_creeps() -> None:
    """Static friction holds it back; below 0.05 m/s that is no news of its mass."""
    guess = CartBody(16.0, (0.3, 0.0), 1.8, (5.0, 5.0))
    measurement = MotionMeasurement(np.zeros(6), 2.5e-5 * np.eye(6))
    learner = CartLearner(guess, measurement, CartPrior())
    before = learner.body_covariance()
    for _ in range(50):
        wrench = np.array([3.0, 0.0, 0.0])
        learner.step(measurement, Push(wrench, np.zeros((3, 3)), PERIOD, wrench))
    np.testing.assert_allclose(learner.body.phi, guess.phi, rtol=1e-12)
    np.testing.assert_allclose(learner.body_covariance(), before, rtol=1e-2, atol=1e-9)


def test_load_changes_are_noticed_and_got_over_within_a_second() -> None:
    found = run(11, 1)
    estimates = found.estimates["p1"]
    assert estimates[-1].jumps == len(found.scenario.loads)
    for load in found.scenario.loads:
        for estimate in estimates:
            if load.at + 1.0 <= estimate.time < load.at + 1.5:
                assert abs(estimate.cart.mass - found.truths[estimate.block].cart.mass) < 0.5


@pytest.mark.slow
def test_after_load_changes_errors_are_as_large_as_it_says() -> None:
    """A second and a half after the last one; the centre of mass is within 5 cm."""
    total = 0.0
    for seed in range(1, 4):
        found = run(11, seed)
        total += float(np.sum(errors_in_deviations(found) ** 2))
        wrong = np.subtract(found.estimates["p1"][-1].cart.com, found.truths[-1].cart.com)
        assert np.hypot(*wrong) < 0.05
    assert chdtri(12, 1.0 - 1e-4) < total < chdtri(12, 1e-4)


@pytest.mark.parametrize(("probability", "jumps"), [(1.5, 0), (0.7, 1)])
def test_false_alarms_are_rare(probability: float, jumps: int) -> None:
    """All goes as expected, but for one sample that is about as improbable as a false alarm may be."""
    prior = CartPrior()
    body, noise = CartBody(16.0, (0.3, 0.0), 1.8, (5.0, 5.0)), 2.5e-5 * np.eye(6)
    state = np.concatenate([np.zeros(6), body.parameters])
    wrench = np.array([40.0, 0.0, 0.0])
    push = Push(wrench, np.zeros((3, 3)), PERIOD, wrench)
    learner = CartLearner(body, MotionMeasurement(state[:6], noise), prior)
    for _ in range(75):  # so few that they are not judged: one step a sample is not quite what wheels do
        learner.step(MotionMeasurement(state[:6], noise), push)
        state = move(state, wrench, PERIOD)
    threshold = chdtri(INNOVATION_SIZE, probability * FALSE_ALARMS)

    def surprise(away: float) -> float:
        seen, point = MotionMeasurement(state[:6] + away * np.eye(6)[0], noise), learner.belief.mean
        return update(learner.belief, seen, prior.slip, point, corrects_cart=True).surprise

    away = brentq(lambda away: surprise(away) - threshold, 0.0, 1.0)
    learner.step(MotionMeasurement(state[:6] + away * np.eye(6)[0], noise), push)
    assert learner.jumps == jumps


@pytest.mark.slow
def test_casters_that_turn_round_are_no_change_of_the_cart() -> None:
    """15 N that no robot measures, for almost a second, twice, and 3 N of noise on the wrench."""
    found = run(12, 1)
    late = [e for e in found.estimates["p1"] if e.time > 5.0]
    assert max(abs(e.cart.mass - 20.0) for e in late) < 1.0
    assert late[-1].jumps == 0


def test_noise_of_the_wrench_does_not_make_the_cart_look_heavier() -> None:
    """With slopes at the measured wrench it gained a kilogram in seven seconds at an even speed."""
    scenario = structs.replace(table_one(1), force_noise=3.0, duration=15.0)
    estimates = run_in_process(scenario).estimates["p1"]
    even = [e.cart.mass for e in estimates if e.time > 5.0]
    assert max(even) - min(even) < 0.1


def claims_within(found: CartRun, deviations: float) -> bool:
    """Whether all that the pusher has claimed to know was true."""
    for estimate in found.estimates["p1"]:
        cart, truth = estimate.cart, found.truths[estimate.block].cart
        errors = np.subtract(
            [cart.mass, *cart.com, cart.inertia, *cart.friction],
            [truth.mass, *truth.com, truth.inertia, *truth.friction],
        )
        is_known = np.array([name not in estimate.not_known for name in QUANTITIES])
        if (np.abs(errors) > deviations * np.sqrt(np.diag(estimate.covariance)) + 1e-12)[is_known].any():
            return False
    return True


@pytest.mark.parametrize("share", [0.9, pytest.param(2.0, marks=pytest.mark.slow)])
def test_friction_of_turning_is_found_beside_that_of_moving(share: float) -> None:
    """With one number for both, a share of 0.9 cost 11 kg and twelve jumps, and was taken for ``d_x``."""
    found = run_in_process(structs.replace(table_one(5, turning_friction=share), duration=12.0))
    last = found.estimates["p1"][-1]
    assert last.jumps == 0
    assert not last.not_known
    assert last.cart.friction[1] == pytest.approx(5.0 * share, abs=0.3)
    assert abs(last.cart.mass - 20.0) < 0.1
    assert claims_within(found, 5.0)


def test_a_crate_is_no_point() -> None:
    """Of 0.9 m by 0.6 m, put on aside: what is said of the moment of inertia in the curves after it is true."""
    crate = CartLoad(at=6.0, mass=12.0, place=(0.45, 0.1), size=(0.9, 0.6))
    found = run_in_process(structs.replace(table_one(5), loads=(crate,), duration=11.0))
    last = found.estimates["p1"][-1]
    assert last.jumps == 1
    assert not {"mass", "d_y", "inertia"} & last.not_known.keys()
    assert claims_within(found, 5.0)


def test_noise_that_it_is_not_told_of_is_noticed_and_counts() -> None:
    found = run_in_process(structs.replace(table_one(5, noise_factor=4.0), duration=6.0))
    last = found.estimates["p1"][-1]
    assert len(last.doubts) == 4
    assert last.jumps == 0
    assert claims_within(found, 5.0)
    assert not run(5, 1, 13.0).estimates["p1"][-1].doubts


def run_alone(
    scenario: CartScenario, told: CartScenario, change: Callable[[CartMeasurement], CartMeasurement]
) -> CartRun:
    """Run with one pusher that is configured as in another scenario, and that gets changed measurements."""
    simulation, agent = CartSimulation(scenario), CartAgent(agent_config(told, "p1", ()))
    found = CartRun(scenario, [], {"p1": []})
    pushes: dict[int, CartPush] = {}
    for block in range(scenario.blocks):
        due = pushes.pop(block, None)
        sample = simulation.advance({} if due is None else {"p1": due})
        found.truths.append(sample.truth)
        outbox = agent.step(change(sample.measurements["p1"]), [])
        pushes[outbox.push.block] = outbox.push
        if outbox.estimate is not None:
            found.estimates["p1"].append(outbox.estimate)
    return found


@pytest.mark.parametrize("factor", [pytest.param(4.0, marks=pytest.mark.slow), 10.0])
def test_noise_that_rises_suddenly_is_not_taken_for_many_changes(factor: float) -> None:
    """The first noisy samples look like another cart; with an alarm at each of them, the filter diverged."""
    scenario, rng = structs.replace(table_one(5, seed=2), duration=11.0), np.random.default_rng(2)

    def noisier(measurement: CartMeasurement) -> CartMeasurement:
        more = np.sqrt(factor**2 - 1.0) * scenario.noise if measurement.block >= 7.0 * scenario.rate else 0.0
        return structs.replace(measurement, motion=measurement.motion + more * rng.standard_normal(6))

    found = run_alone(scenario, scenario, noisier)
    last = found.estimates["p1"][-1]
    assert last.jumps <= 3
    assert len(last.doubts) == 4
    assert claims_within(found, 5.0)


@pytest.mark.slow
def test_forces_that_it_does_not_measure_are_noticed() -> None:
    """3 N of noise on the wrench, of which it is told nothing."""
    scenario = structs.replace(table_one(5, turning_friction=0.7), duration=8.0, force_noise=3.0)
    last = run_alone(scenario, table_one(5), lambda measurement: measurement).estimates["p1"][-1]
    assert "N acts on the cart" in last.doubts[-1]
    assert last.cart.mass == pytest.approx(20.0, abs=5.0 * float(np.sqrt(last.covariance[0, 0])))


def test_nothing_is_claimed_before_measurements_have_been_judged() -> None:
    estimates = run(5, 1, 13.0).estimates["p1"]
    assert all(set(estimate.not_known) == set(QUANTITIES) for estimate in estimates if estimate.time < 1.0)


@pytest.mark.parametrize(
    "phi", [[-3.0, 0.0, 0.0, 1.0], [20.0, 6.0, 3.0, 1.0], [20.0, 6.0, 3.0, -4.0], [4.0, -90.0, 40.0, 9.0]]
)
def test_there_is_a_cart_near_every_estimate(phi: list[float]) -> None:
    body = CartBody.of(nearest_possible(np.array(phi), 4.0, 0.5), (0.0, 0.0))
    assert body.mass >= 4.0
    assert body.inertia >= 0.5 - 1e-12
    assert np.hypot(*body.com) < 2.0 + 1e-12


def test_smoothed_states_are_those_of_least_squares() -> None:
    """Of a short linear chain: prior, three measurements, three steps, all about one point."""
    rng = np.random.default_rng(2)
    body = CartBody(20.0, (0.3, 0.1), 2.0, (5.0, 5.0))
    point = np.concatenate([[0.0, 0.0, 0.2, 1.0, 0.2, 0.3], body.parameters])
    root = 0.1 * rng.standard_normal((12, 12))
    belief = Belief(point, root @ root.T)
    wrench = np.array([20.0, 0.0, -2.0])
    push = Push(wrench, np.diag([4.0, 4.0, 0.1]), 0.1, wrench)
    steps: list[tuple[Update, Prediction]] = []
    measurements = [MotionMeasurement(point[:6] + 0.05 * rng.standard_normal(6), 0.01 * np.eye(6)) for _ in range(3)]
    for measurement in measurements:
        updated = update(belief, measurement, 0.1, point, corrects_cart=True)
        prediction = predict(updated.belief, push, 1e-3 * np.eye(6), point)
        steps.append((updated, prediction))
        belief = prediction.belief
    # The last measurement tells of the state before as well: condition their joint distribution on all measurements.
    first = steps[0][0].belief
    transition = steps[0][1].transition
    joint = np.block(
        [
            [first.covariance, first.covariance @ transition.T],
            [transition @ first.covariance, steps[0][1].belief.covariance],
        ]
    )
    mean = np.concatenate([first.mean, steps[0][1].belief.mean])
    later = smooth(steps)[1]
    # Smoothing the first state from the second one, smoothed with the update undone (Rauch, Tung, Striebel).
    gain = joint[:12, 12:] @ np.linalg.pinv(joint[12:, 12:], rcond=1e-13)
    np.testing.assert_allclose(smooth(steps)[0], mean[:12] + gain @ (later - mean[12:]), atol=1e-6)
    np.testing.assert_allclose(smooth(steps)[-1], steps[-1][0].belief.mean, atol=1e-12)
