"""What may suddenly happen to a cart, against carts to which it happened."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.cart_model import CartBody
from coheft.estimation.cart_prior import CartPrior


@pytest.mark.parametrize("com", [(0.3, 0.15), (0.0, 0.0)])
def test_loads_spread_phi_as_the_prior_says(com: tuple[float, float]) -> None:
    prior, count = CartPrior(), 200_000
    rng = np.random.default_rng(1)
    masses = prior.load * rng.standard_normal(count)
    x, y = (np.array(com) + prior.place * rng.standard_normal((count, 2))).T
    changes = masses * [np.ones(count), x, y, x * x + y * y]
    expected = prior.load_covariance(CartBody(20.0, com, 2.0, 5.0))
    deviations = np.sqrt(np.diag(expected))
    scale = np.outer(deviations, deviations)
    np.testing.assert_allclose(changes @ changes.T / count / scale, expected / scale, atol=0.05)
