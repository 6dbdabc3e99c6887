"""Projection onto the physically possible bodies: always possible, and the best one."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.consistency import is_possible, nearest_possible, parameters_of
from coheft.estimation.rigid_body.mass_properties import Inertia, pseudo_inertia
from tests.rigid_motions import Particles, bodies, vectors

LENGTH = 0.5


def random_information(rng: np.random.Generator, rank: int = 10) -> Array:
    root = rng.normal(size=(10, rank)) * 10.0 ** rng.uniform(-1, 2, rank)
    return root @ root.T


def random_estimate(rng: np.random.Generator, error: float) -> Array:
    body = Inertia(10.0, rng.normal(size=3) * 0.2, np.diag([0.4, 0.9, 1.2]))
    return body.barycentric() + error * rng.normal(size=10)


def impossible_estimates(count: int) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(0)
    drawn = ((random_estimate(rng, error), random_information(rng)) for error in [0.3, 1.0, 5.0] * count)
    return [(estimate, information) for estimate, information in drawn if not is_possible(estimate)][:count]


@given(bodies)
def test_pseudo_inertia_is_that_of_the_body(body: Particles) -> None:
    inertia = Inertia(float(body.masses.sum()), body.com(), body.tensor())
    pseudo = pseudo_inertia(inertia.barycentric())
    np.testing.assert_allclose(pseudo, inertia.pseudo_inertia(), atol=1e-12 * np.abs(pseudo).max())
    np.testing.assert_allclose(parameters_of(pseudo), inertia.barycentric(), atol=1e-12 * np.abs(pseudo).max())


def test_possible_estimates_stay_as_they_are() -> None:
    parameters = random_estimate(np.random.default_rng(1), 0.0)
    assert nearest_possible(parameters, np.eye(10), LENGTH) is parameters


def test_thin_rods_are_bodies_and_triangle_inequality_and_negative_mass_are_not() -> None:
    assert is_possible(Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 1e-3])).barycentric())
    assert not is_possible(Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 2.01])).barycentric())
    assert not is_possible(-Inertia(1.0, np.zeros(3), np.eye(3)).barycentric())
    assert not is_possible(np.zeros(10))


@given(vectors(100.0, 10), st.integers(0, 2**32 - 1), st.integers(1, 10), st.floats(-8.0, 8.0), st.floats(-2.0, 1.0))
def test_the_result_is_a_body_whatever_is_given(
    parameters: Array, seed: int, rank: int, decades: float, length: float
) -> None:
    information = 10.0**decades * random_information(np.random.default_rng(seed), rank)
    inertia = Inertia.from_barycentric(nearest_possible(parameters, information, 10.0**length))
    assert is_possible(inertia.barycentric())
    assert inertia.mass > 0.0
    assert np.linalg.eigvalsh(inertia.pseudo_inertia())[0] > 0.0


def test_no_other_body_is_more_likely() -> None:
    rng = np.random.default_rng(2)
    for estimate, information in impossible_estimates(20):
        best = nearest_possible(estimate, information, LENGTH)
        cost = 0.5 * (best - estimate) @ information @ (best - estimate)
        # All bodies between the best and any other are possible; the cost is convex, so looking near is enough.
        roots = rng.normal(size=(200, 4, 4))
        others = np.array([parameters_of(root @ root.T) for root in roots])
        for share in 1e-3, 1e-2, 1e-1:
            error = best + share * (others - best) - estimate
            assert 0.5 * np.einsum("ni,ij,nj->n", error, information, error).min() > cost * (1.0 - 1e-5) - 1e-5


def test_moments_in_another_unit_are_no_obstacle() -> None:
    """A fit of moments in N·mm: directions differ by many powers of ten, and no body is far from impossible."""
    fit = np.array([1.9, 1e3, 230.0, -800.0, -2e3, 2.2e3, -1.2e3, -520.0, -1.9e3, 660.0])
    root = np.zeros((10, 10))
    root[np.tril_indices(10)] = 1e-6 * np.array(
        [
            *(380000, -25000, 77000, 33000, -42000, 62000, 100000, -250000, 100000, 51000, 350, 450, 370, -400, 970),
            *(170, -38, -28, -330, -150, 530, -85, 490, 230, -140, 430, -310, 760, -51, 440, 660, -1500, -81, -410),
            *(460, 1300, -220, -1500, -320, 1100, -880, -630, -860, 170, 310, -420, 200, 430, -1200, -1000, -730),
            *(-140, 840, -1400, 6.9),
        ]
    )
    for seed in range(10):
        estimate = fit * (1.0 + 1e-3 * np.random.default_rng(seed).normal(size=10))
        assert is_possible(nearest_possible(estimate, root @ root.T, 0.5))


def test_a_mass_that_is_known_is_no_obstacle() -> None:
    """Some directions are known up to a million million times better than others."""
    rng = np.random.default_rng(5)
    for _ in range(20):
        axes = np.linalg.qr(rng.normal(size=(10, 10)))[0]
        information = axes @ np.diag(10.0 ** rng.uniform(0.0, 5.0, 10)) @ axes.T
        information[0, 0] += 10.0 ** rng.uniform(6.0, 14.0)
        estimate = np.concatenate([[10.0], rng.normal(size=3), 3.0 * rng.normal(size=6)])
        body = nearest_possible(estimate, information, LENGTH)
        assert is_possible(body, 0.0)
        assert abs(body[0] - 10.0) < 0.1


def test_agrees_with_a_general_purpose_optimiser() -> None:
    lower = np.tril_indices(4)

    def body_of(entries: Array) -> Array:
        root = np.zeros((4, 4))
        root[lower] = entries
        return parameters_of(root @ root.T)

    for estimate, information in impossible_estimates(5):
        best = nearest_possible(estimate, information, LENGTH)

        def cost(parameters: Array, estimate: Array = estimate, information: Array = information) -> float:
            return float(0.5 * (parameters - estimate) @ information @ (parameters - estimate))

        start = np.linalg.cholesky(pseudo_inertia(random_estimate(np.random.default_rng(3), 0.0)))[lower]
        reference = minimize(lambda entries: cost(body_of(entries)), start, method="BFGS", options={"maxiter": 5000})
        assert cost(best) < reference.fun * (1.0 + 1e-5) + 1e-5
