"""What may suddenly happen to a cart, and what is found out about it, against carts to which it happened."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import chdtri

from coheft.estimation.cart.load import UnknownLoad, change_of_phi, linearised
from coheft.estimation.cart.model import CartBody
from coheft.estimation.cart.prior import CartPrior
from coheft.estimation.geometry.spatial import Array
from tests.cart.carts import differences

PRIOR = CartPrior()
OWN = 0.5 * PRIOR.size**2
"""A load's squared radius of gyration, more or less [m²]."""
KNOWN = np.diag([1e-4, 1e-5, 1e-5, 1e-4])
"""Covariance of a cart that has been pushed for some seconds."""


def loads(com: tuple[float, float], count: int, seed: int) -> Array:
    """Such as the prior expects, ``(dm, r_x, r_y, k)``, shape (count, 4)."""
    deviations = np.array([PRIOR.load, PRIOR.place, PRIOR.place, OWN])
    found: Array = np.array([0.0, *com, OWN]) + deviations * np.random.default_rng(seed).standard_normal((count, 4))
    return found


def look(load: UnknownLoad, phi: Array, noise: Array) -> tuple[Array, Array]:
    """``phi`` (4,) measured directly, several times anew: what follows from it, and its covariance."""
    found, after = phi, noise
    for _ in range(4):
        expected, spread = load.start()
        gain = np.linalg.solve(spread + noise, spread).T
        found, after = expected + gain @ (phi - expected), spread - gain @ spread
        load.learn(found, after)
    return found, after


@pytest.mark.parametrize("com", [(0.3, 0.15), (0.0, 0.0)])
def test_loads_spread_phi_as_it_is_said(com: tuple[float, float]) -> None:
    phi = CartBody(20.0, com, 2.0, (5.0, 5.0)).phi
    mean, spread = UnknownLoad(phi, KNOWN, PRIOR).start()
    changes = change_of_phi(loads(com, 200_000, 1))
    scale = np.sqrt(np.outer(np.diag(spread), np.diag(spread)))
    np.testing.assert_allclose(mean, phi, atol=1e-12)
    np.testing.assert_allclose((np.cov(changes.T) + KNOWN) / scale, spread / scale, atol=0.05)


def test_the_law_for_a_known_load_is_the_tangent() -> None:
    mean = np.array([5.0, 0.3, -0.1, 0.01])
    law = linearised(mean, 1e-8 * np.eye(4))
    np.testing.assert_allclose(law.slope, differences(change_of_phi, mean), atol=1e-6)
    np.testing.assert_allclose(law.middle, change_of_phi(mean), atol=1e-6)
    np.testing.assert_allclose(law.rest, np.zeros((4, 4)), atol=1e-12)


def test_where_a_load_lies_says_what_it_does_to_the_moment_of_inertia() -> None:
    """Straight on, all but the moment of inertia shows; the cart's is then as sure as the load's own."""
    com, placed = (0.3, 0.0), np.array([5.0, 0.35, 0.02, 0.0])
    body = CartBody(20.0, com, 2.0, (5.0, 5.0))
    load = UnknownLoad(body.phi, KNOWN, PRIOR)
    truth = body.phi + change_of_phi(placed)
    _, unsure = load.start()
    found, after = look(load, truth, np.diag([1e-3, 1e-4, 1e-4, 1e3]))
    own = 5.0 * OWN
    assert np.sqrt(unsure[3, 3]) > 5.0 * own
    assert np.sqrt(after[3, 3]) < 2.0 * own
    np.testing.assert_allclose(found[3], truth[3], atol=2.0 * own)


def test_what_is_said_of_the_cart_after_a_load_is_true() -> None:
    """Normalised errors squared of many carts whose parameters are measured directly, and several times anew."""
    com, noise = (0.3, 0.15), np.diag([1e-2, 3e-3, 3e-3, 1.0])
    body, rng, total = CartBody(20.0, com, 2.0, (5.0, 5.0)), np.random.default_rng(2), 0.0
    placed = loads(com, 500, 3)
    for each in placed:
        before = rng.multivariate_normal(body.phi, KNOWN)
        truth = body.phi + change_of_phi(each)
        measured = rng.multivariate_normal(truth, noise)
        load = UnknownLoad(before, KNOWN, PRIOR)
        found, after = look(load, measured, noise)
        total += float((found - truth) @ np.linalg.solve(after, found - truth))
    assert chdtri(4 * len(placed), 1.0 - 1e-3) < total < chdtri(4 * len(placed), 1e-3)
