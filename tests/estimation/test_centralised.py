from __future__ import annotations

import numpy as np
import pytest

from coheft.app.study.samples import simulate
from coheft.estimation.body_motion import perturbation_between
from coheft.estimation.centralised import estimate_centralised, sum_up
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import pack_symmetric
from physics_server.scene import place_grasps
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


def test_offsets_of_force_and_torque_are_estimated_along() -> None:
    quiet = scenario(rate=200, block=10, duration=3.0)
    samples = simulate(quiet).samples
    samples[:, :, 9:] += np.random.default_rng(1).uniform(-1.0, 1.0, size=(3, 6)) * [2.0, 2.0, 2.0, 0.1, 0.1, 0.1]
    truth = quiet.payload.inertia().carried(place_grasps(quiet)[0].inverse())
    ignored = estimate_centralised(samples, PERFECT, rate=200)
    estimated = estimate_centralised(samples, PERFECT, rate=200, with_offset=True)
    assert np.linalg.norm(ignored.inertia.com - truth.com) > 1e-3
    np.testing.assert_allclose(estimated.inertia.com, truth.com, atol=1e-5)


def test_samples_must_be_of_as_many_robots_as_there_are_poses() -> None:
    quiet = scenario(rate=200, block=10, duration=0.1)
    with pytest.raises(ValueError, match=r"samples.shape=\(20, 3, 15\) but expected \(n, 2, 15\)"):
        sum_up(simulate(quiet).samples, place_grasps(quiet)[:2], SensorNoise(), rate=200)
