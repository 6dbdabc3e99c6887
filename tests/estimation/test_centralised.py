from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.stats import chi2

from coheft.app.study.samples import simulate
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.centralised import estimate_centralised, sum_up
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import pack_symmetric
from coheft.wire.grasps import place_grasps
from coheft.wire.scenario import Grasp
from tests.estimation.team import make_team
from tests.physics_run import scenario

PERFECT = SensorNoise().scaled(1e-6)


@pytest.mark.parametrize("name", ["ring3", "line4"])
def test_without_noise_the_batch_solution_is_exact(name: str) -> None:
    quiet = scenario(name, rate=200, block=10, duration=3.0)
    grasps = place_grasps(quiet)
    found = estimate_centralised(simulate(quiet).samples, PERFECT, rate=200)
    truth = quiet.payload.inertia().carried(grasps[0].inverse())
    for grasp, pose in zip(grasps, found.poses, strict=True):
        np.testing.assert_allclose(perturbation_between(pose, grasps[0].inverse() @ grasp), np.zeros(6), atol=1e-6)
    assert found.inertia.mass == pytest.approx(truth.mass, rel=1e-6)
    np.testing.assert_allclose(found.inertia.com, truth.com, atol=1e-6)
    np.testing.assert_allclose(pack_symmetric(found.inertia.tensor - truth.tensor), np.zeros(6), atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_slopes_of_gyros_are_not_guessed_where_the_run_begins_and_ends(seed: int) -> None:
    """Accelerometers of two robots do not show how fast a turn about the line between them gets faster."""
    team = make_team(seed, count=2, duration=2.0)
    found = estimate_centralised(team.exact, PERFECT, rate=100)
    np.testing.assert_allclose(found.inertia.tensor, team.inertia.tensor, atol=2e-5)
    np.testing.assert_allclose(found.inertia.com, team.inertia.com, atol=1e-7)
    assert found.rows == slice(2, 198)
    assert found.residual.shape == (196, 6)
    assert np.abs(found.residual).max() < 1e-3  # with guessed slopes of the ends, about 1


def test_offsets_of_force_and_torque_are_estimated_along() -> None:
    quiet = scenario(rate=200, block=10, duration=3.0)
    samples = simulate(quiet).samples
    samples[:, :, 9:] += np.random.default_rng(1).uniform(-1.0, 1.0, size=(3, 6)) * [2.0, 2.0, 2.0, 0.1, 0.1, 0.1]
    truth = quiet.payload.inertia().carried(place_grasps(quiet)[0].inverse())
    ignored = estimate_centralised(samples, PERFECT, rate=200)
    estimated = estimate_centralised(samples, PERFECT, rate=200, with_offset=True)
    assert np.linalg.norm(ignored.inertia.com - truth.com) > 1e-3
    np.testing.assert_allclose(estimated.inertia.com, truth.com, atol=1e-5)
    np.testing.assert_allclose(estimated.residual, np.zeros((600, 6)), atol=1e-4)


def test_robots_nearly_in_a_line_know_how_well_they_know_their_poses() -> None:
    # Of turning about the line the gyros' slope says more than the accelerometers, and it is made use of.
    base = scenario("ring3", rate=200, block=10, duration=6.0, noise_scale=1.0)
    places = ((0.0, 0.0, 0.0), (0.15, 0.04, 0.0), (0.3, 0.0, 0.14))
    robots = msgspec.structs.replace(base.robots, perimeter=None, grasps=tuple(Grasp(position=p) for p in places))
    squares = []
    for seed in range(8):
        one = msgspec.structs.replace(base, robots=robots, seed=seed)
        grasps = place_grasps(one)
        found = estimate_centralised(simulate(one).samples, one.sensors.noise, rate=200)
        steps = [perturbation_between(p, grasps[0].inverse() @ g) for p, g in zip(found.poses, grasps, strict=True)]
        error = np.concatenate(steps[1:])
        squares.append(error @ np.linalg.solve(found.team.covariance[6:, 6:], error))
    assert chi2.ppf(1e-4, 12 * 8) < sum(squares) < chi2.ppf(1.0 - 1e-4, 12 * 8)


def test_samples_must_be_of_as_many_robots_as_there_are_poses() -> None:
    quiet = scenario(rate=200, block=10, duration=0.1)
    with pytest.raises(ValueError, match=r"samples.shape=\(20, 3, 15\) but expected \(n, 2, 15\)"):
        sum_up(simulate(quiet).samples, place_grasps(quiet)[:2], SensorNoise(), rate=200)
