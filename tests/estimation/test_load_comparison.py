"""An estimate of a load that may still be the former one."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.inertia_derivatives import central_derivative
from coheft.estimation.inertia_estimate import InertiaEstimate
from coheft.estimation.load_comparison import KnownLoad, maybe_former
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose


def body(rng: np.random.Generator) -> Inertia:
    place = Pose(np.eye(3), rng.uniform(-0.4, 0.4, 3))
    return Inertia.of_box(rng.uniform(1.0, 9.0), rng.uniform(0.1, 1.0, 3), place)


def estimate_of(inertia: Inertia, covariance: Array) -> InertiaEstimate:
    """As if by least squares, with a covariance (10, 10) of ``theta``."""
    to_central = central_derivative(inertia)
    central = to_central @ covariance @ to_central.T
    return InertiaEstimate(inertia, central, to_central, inertia.barycentric(), covariance, None, ())


@pytest.mark.parametrize("seed", range(5))
def test_it_is_right_about_either_load_however_far_they_are_apart(seed: int) -> None:
    rng = np.random.default_rng(seed)
    now, former = body(rng), body(rng)
    estimate = estimate_of(now, 1e-6 * np.eye(10))
    both = maybe_former(estimate, KnownLoad(former.barycentric(), 1e-6 * np.eye(10)))
    assert both.inertia is now
    apart = former.central() - now.central()
    assert apart @ np.linalg.solve(both.covariance, apart) <= 1.0
    assert np.all(np.linalg.eigvalsh(both.covariance - estimate.covariance) > 0.0)


def test_it_is_no_better_known_than_the_former_load_was() -> None:
    """Where both say the same, the former load's covariance is added, and nothing else."""
    now = body(np.random.default_rng(1))
    estimate, known = estimate_of(now, 1e-6 * np.eye(10)), estimate_of(now, 1e-3 * np.eye(10))
    both = maybe_former(estimate, KnownLoad(now.barycentric(), 1e-3 * np.eye(10)))
    np.testing.assert_allclose(both.covariance, estimate.covariance + known.covariance, atol=1e-12)


def test_a_former_load_that_was_hardly_seen_need_not_be_possible() -> None:
    now = body(np.random.default_rng(2))
    both = maybe_former(estimate_of(now, 1e-6 * np.eye(10)), KnownLoad(np.zeros(10), 1e3 * np.eye(10)))
    assert np.isfinite(both.covariance).all()
    assert both.covariance[0, 0] > now.mass**2
