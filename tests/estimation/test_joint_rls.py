"""The joint filter for inertia, centre of mass and mass."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import chdtri

from coheft.estimation.fan2017.joint_rls import JointRls, joint_regressor
from coheft.estimation.fan2017.mean_noise import MeanNoise
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import Inertia, pack_symmetric
from tests.estimation.team import Team, make_team

Samples = tuple[Array, Array, Array, Array, Array]

RATE = 100.0
WRENCH_COVARIANCE = np.diag(np.repeat([0.5, 0.05], 3)) ** 2
MOTION_COVARIANCE = np.diag(np.repeat([0.05, 0.1], 3)) ** 2


def theta_of(inertia: Inertia) -> Array:
    """``(J, h, 1/m)``."""
    return np.concatenate([pack_symmetric(inertia.tensor), inertia.com, [1.0 / inertia.mass]])


def samples_of(team: Team, inertia: Inertia | None = None) -> Samples:
    """``w, a, alpha, F, T`` in the body frame."""
    w, a, alpha = team.motion[:, :3], team.motion[:, 6:9], team.motion[:, 9:]
    wrench = (inertia or team.inertia).wrench(w, a, alpha)
    return w, a, alpha, wrench[:, :3], wrench[:, 3:]


def noisy(
    samples: Samples,
    rng: np.random.Generator,
    wrench_covariance: Array = WRENCH_COVARIANCE,
    motion_covariance: Array = MOTION_COVARIANCE,
) -> Samples:
    w, a, alpha, force, torque = samples
    wrench = rng.multivariate_normal(np.zeros(6), wrench_covariance, len(w))
    motion = rng.multivariate_normal(np.zeros(6), motion_covariance, len(w))
    return w, a + motion[:, :3], alpha + motion[:, 3:], force + wrench[:, :3], torque + wrench[:, 3:]


def new_filter(forgetting: float = 1.0, scale: float = 1.0) -> JointRls:
    return JointRls(np.zeros(3), scale * WRENCH_COVARIANCE, scale * MOTION_COVARIANCE, forgetting)


def feed(joint_filter: JointRls, samples: Samples, block: int) -> None:
    for start in range(0, len(samples[0]), block):
        joint_filter.update(*(part[start : start + block] for part in samples))


@pytest.mark.parametrize("seed", range(5))
def test_regressor_is_linear_in_the_unknowns(seed: int) -> None:
    team = make_team(seed, duration=1.0)
    matrix, right_side = joint_regressor(*samples_of(team))
    np.testing.assert_allclose(matrix @ theta_of(team.inertia), right_side, atol=1e-10)


@pytest.mark.parametrize("forgetting", [0.99, 1.0])
@pytest.mark.parametrize("seed", range(3))
def test_exact_data_give_the_exact_payload(seed: int, forgetting: float) -> None:
    team = make_team(seed, duration=5.0)
    # Exact data deserve trust: then the prior, which says 1 kg, weighs next to nothing.
    joint_filter = new_filter(forgetting, scale=1e-12)
    feed(joint_filter, samples_of(team), block=10)
    np.testing.assert_allclose(joint_filter.theta, theta_of(team.inertia), atol=1e-9)


@pytest.mark.parametrize("forgetting", [0.98, 1.0])
def test_blocks_are_the_recursion_sample_by_sample(forgetting: float) -> None:
    # With noise in T and a only, the weight does not follow the estimate; in few samples noise is not measured.
    wrench_covariance = np.diag(np.repeat([0.0, 0.05], 3)) ** 2
    motion_covariance = np.diag(np.repeat([0.05, 0.0], 3)) ** 2
    samples = noisy(samples_of(make_team(1, duration=3.0)), np.random.default_rng(2))
    by_block, by_sample = (
        JointRls(np.array([0.1, 0.0, 0.0]), wrench_covariance, motion_covariance, forgetting) for _ in range(2)
    )
    feed(by_block, samples, block=5)
    feed(by_sample, samples, block=1)
    np.testing.assert_allclose(by_block.theta, by_sample.theta, atol=1e-9)


PARTS = {"inertia": range(6), "com": range(6, 9), "mass": range(9, 10)}


@pytest.mark.parametrize("parts", [["com"], ["inertia"], ["mass"], ["com", "inertia"], ["com", "mass"], [*PARTS]])
def test_what_is_known_beforehand_moves_to_the_right_hand_side(parts: list[str]) -> None:
    """Eqs (25) to (27): least squares for the rest, with constant weights solved in one go."""
    team = make_team(6, duration=3.0)
    samples, truth = noisy(samples_of(team), np.random.default_rng(7)), theta_of(team.inertia)
    known = [k for part in parts for k in PARTS[part]]
    rest = [k for k in range(10) if k not in known]
    joint_filter = JointRls(
        np.zeros(3), WRENCH_COVARIANCE, MOTION_COVARIANCE, 1.0,
        known={k: truth[k] for k in known}, is_weighted_by_state=False,
    )  # fmt: skip
    feed(joint_filter, samples, block=20)
    matrix, right_side = joint_regressor(*samples)
    deviations = np.concatenate([np.full(3, 0.05), np.full(3, 0.05)])  # of T and a
    whole = (matrix / deviations[:, None]).reshape(-1, 10)
    target = (right_side / deviations).ravel() - whole[:, known] @ truth[known]
    expected = np.linalg.lstsq(whole[:, rest], target)[0]
    np.testing.assert_array_equal(joint_filter.theta[known], truth[known])
    np.testing.assert_allclose(joint_filter.theta[rest], expected, rtol=2e-3, atol=1e-4)
    assert (np.diag(joint_filter.covariance())[known] < 1e-10).all()
    np.linalg.inv(joint_filter.covariance())


def test_the_first_guess_of_the_mass_holds_until_there_are_samples() -> None:
    assert JointRls(np.zeros(3), WRENCH_COVARIANCE, MOTION_COVARIANCE, 1.0, mass=4.0).theta[9] == 0.25


def test_forgetting_follows_a_change() -> None:
    """The old load's share fades with every memory's time; without forgetting it stays."""
    team = make_team(3, duration=10.0)
    heavier = Inertia(26.0, team.inertia.com + 0.05, 1.3 * team.inertia.tensor)
    memory, change, end = 50, 500, 900
    samples = tuple(
        np.concatenate([old[:change], new[change:end]])
        for old, new in zip(samples_of(team), samples_of(team, heavier), strict=True)
    )

    def error(forgetting: float, until: int) -> float:
        joint_filter = new_filter(forgetting, scale=1e-12)
        feed(joint_filter, tuple(part[:until] for part in samples), block=5)  # too few to measure noise
        return float(np.abs(joint_filter.theta - theta_of(heavier)).max())

    forgetful = [error(1.0 - 1.0 / memory, until) for until in (change, change + 2 * memory, change + 4 * memory, end)]
    assert forgetful[0] > 0.5
    assert forgetful[0] > forgetful[1] > forgetful[2] > forgetful[3]
    assert forgetful[3] < 0.02 * forgetful[0]
    assert error(1.0, end) > 0.1


def test_surprise_tells_a_change_and_nothing_else() -> None:
    team = make_team(4, duration=10.0)
    rng = np.random.default_rng(5)
    heavier = Inertia(1.2 * team.inertia.mass, team.inertia.com, team.inertia.tensor)
    joint_filter = new_filter(forgetting=0.995)
    feed(joint_filter, noisy(samples_of(team), rng), block=10)
    usual = []
    for start in range(0, 500, 10):
        joint_filter.update(*(part[start : start + 10] for part in noisy(samples_of(team), rng)))
        usual.append(joint_filter.surprise)
    assert max(usual) < 4.0
    joint_filter.update(*(part[:10] for part in noisy(samples_of(team, heavier), rng)))
    assert joint_filter.surprise > 10.0 * max(usual)


def test_covariance_stays_bounded_without_excitation() -> None:
    team = make_team(4, duration=5.0)
    joint_filter = new_filter(forgetting=0.98)
    feed(joint_filter, samples_of(team), block=10)
    moving = np.diag(joint_filter.covariance()).copy()
    still, gravity, rng = np.zeros((10, 3)), np.tile([0.0, 0.0, 9.81], (10, 1)), np.random.default_rng(5)
    wrench = team.inertia.wrench(still, gravity, still)
    for _ in range(2000):
        joint_filter.update(*noisy((still, gravity, still, wrench[:, :3], wrench[:, 3:]), rng))
    at_rest = np.diag(joint_filter.covariance())
    assert (moving[:6] < 1e-2).all()
    # Noise alone tells nothing of what rest cannot tell, which was next to unknown at first; the weight is still known.
    off = joint_filter.theta - theta_of(team.inertia)
    assert (np.abs(off) < 4.0 * np.sqrt(at_rest)).all()
    assert (at_rest[:6] > 25.0).all()
    assert (at_rest[:9] < 4.0 * np.repeat([100.0, 1.0], [6, 3])).all()
    np.testing.assert_allclose(1.0 / joint_filter.theta[9], team.inertia.mass, rtol=1e-3)


def test_errors_are_as_large_as_the_covariance_says() -> None:
    """Over 60 motions, with noise where least squares expects it: in T and a, not in the regressor."""
    runs = 60
    wrench_covariance = np.diag(np.repeat([0.0, 0.05], 3)) ** 2
    motion_covariance = np.diag(np.repeat([0.05, 0.0], 3)) ** 2
    squares = []
    for run in range(runs):
        team = make_team(run, duration=4.0)
        joint_filter = JointRls(np.zeros(3), wrench_covariance, motion_covariance, 1.0)
        samples = noisy(samples_of(team), np.random.default_rng(run), wrench_covariance, motion_covariance)
        feed(joint_filter, samples, block=20)
        error = joint_filter.theta - theta_of(team.inertia)
        squares.append(error @ np.linalg.solve(joint_filter.covariance(), error))
    low, high = chdtri(10 * runs, [0.999, 0.001]) / runs
    assert low / 1.1 < np.mean(squares) < 1.1 * high


@pytest.mark.parametrize("is_differentiated", [False, True])
def test_what_is_forgotten_and_what_all_share_enter_the_covariance(is_differentiated: bool) -> None:
    """Three robots' own estimates, old samples half forgotten, noise in all inputs, larger than it was guessed.

    Noise of alpha is white, or that of a differentiated gyro and larger.
    """
    runs, robots, block, memory = 16, 3, 10, 20.0
    squares, own_squares = [], []
    for run in range(runs):
        team, rng = make_team(run, duration=10.0), np.random.default_rng(run)
        w, a, alpha, force, torque = noisy(samples_of(team), rng)
        if is_differentiated:
            gyro = rng.normal(size=(len(w) + 2, 3))
            alpha = team.motion[:, 9:] + 0.5 * (gyro[2:] - gyro[:-2]) / np.sqrt(2.0)
        filters = [new_filter(forgetting=1.0 - 1.0 / (memory * block), scale=0.1) for _ in range(robots)]
        own_a = [team.motion[:, 6:9] + 0.05 * rng.normal(size=a.shape) for _ in range(robots)]
        noise = MeanNoise(memory)
        for start in range(0, len(w), block):
            now = slice(start, start + block)
            for joint_filter, own in zip(filters, own_a, strict=True):
                joint_filter.update(w[now], own[now], alpha[now], force[now], torque[now])
            moved = np.mean([joint_filter.moved for joint_filter in filters], axis=0)
            noise.measure(np.linalg.solve(filters[0].gain, moved), filters[0])
        errors = [joint_filter.theta - theta_of(team.inertia) for joint_filter in filters]
        mean = np.mean(errors, axis=0)
        squares.append(mean @ np.linalg.solve(filters[0].covariance(noise.share), mean))
        own_squares.append(errors[0] @ np.linalg.solve(filters[0].covariance(), errors[0]))
    for found in (squares, own_squares):  # differences cancel between blocks, too, which is not counted on
        assert (0.5 if is_differentiated else 0.7) < np.mean(found) / 10.0 < 1.4


def test_covariances_are_positive_from_the_first_block_on() -> None:
    """Whatever is fed: noise that is larger than is guessed, correlated, without any load that explains it."""
    rng, rounding = np.random.default_rng(3), -1e-9
    for _ in range(20):
        joint_filter = JointRls(np.zeros(3), 1e-4 * WRENCH_COVARIANCE, 1e-4 * MOTION_COVARIANCE, 0.99)
        mixing = rng.normal(size=(15, 15))
        for block in range(12):
            samples = np.split(rng.normal(size=(10, 15)) @ mixing, 5, axis=1)
            joint_filter.update(*samples)
            if block == 6:
                joint_filter.note_change()
            for covariance in (joint_filter.covariance(), joint_filter.covariance(0.2 * np.eye(10))):
                deviations = np.sqrt(covariance.diagonal())
                assert np.linalg.eigvalsh(covariance / np.outer(deviations, deviations)).min() > rounding
            old = joint_filter.covariance_of_old
            assert np.linalg.eigvalsh(old).min() >= rounding * np.abs(old).max()


def test_noise_of_alpha_does_not_make_inertia_smaller() -> None:
    team = make_team(8, duration=20.0)
    motion_covariance = np.diag(np.repeat([0.05, 0.5], 3)) ** 2
    samples = noisy(samples_of(team), np.random.default_rng(9), motion_covariance=motion_covariance)
    joint_filter = JointRls(np.zeros(3), WRENCH_COVARIANCE, MOTION_COVARIANCE, 1.0)
    feed(joint_filter, samples, block=10)
    errors = joint_filter.theta - theta_of(team.inertia)
    assert (np.abs(errors) < 4.0 * np.sqrt(joint_filter.covariance().diagonal())).all()
    plain = JointRls(np.zeros(3), WRENCH_COVARIANCE, motion_covariance, 1.0, is_weighted_by_state=False)
    feed(plain, samples, block=10)
    assert np.linalg.norm(errors[:6]) < 0.5 * np.linalg.norm((plain.theta - theta_of(team.inertia))[:6])


def test_a_lag_of_the_sums_makes_the_mass_larger_by_as_much_as_is_said() -> None:
    """Total force that is off by a tenth, independent of the motion: noise in the regressor, but none that is white."""
    team = make_team(8, duration=40.0)
    w, a, alpha, force, torque = noisy(samples_of(team), np.random.default_rng(9))
    times = np.arange(len(w)) / RATE
    lag = np.zeros((len(w), 12))
    lag[:, :3] = 0.1 * np.linalg.norm(force, axis=1).mean() * np.sin(2.0 * times[:, None] + np.array([0.0, 1.0, 2.0]))
    joint_filter = JointRls(np.zeros(3), WRENCH_COVARIANCE, MOTION_COVARIANCE, 1.0)
    for start in range(0, len(w), 10):
        now = slice(start, start + 10)
        joint_filter.update(w[now], a[now], alpha[now], force[now] - lag[now, :3], torque[now], lag=lag[now][::5])
    off = joint_filter.theta - theta_of(team.inertia)
    assert -off[9] * team.inertia.mass > 0.004
    assert 0.7 < -joint_filter.by_lag[9] / off[9] < 1.3
    unexplained = off + joint_filter.by_lag
    assert (np.abs(unexplained) < 4.0 * np.sqrt(joint_filter.covariance().diagonal())).all()
