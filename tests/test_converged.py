"""When an estimate is called converged."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.agents.estimator import inertia_std, is_converged
from coheft.estimation.rigid_body.mass_properties import unpack_symmetric
from coheft.wire.messages.structs import PayloadEstimate
from coheft.wire.scenario.estimator_settings import Converged

LIMITS = Converged(mass_percent=2.0, com_mm=3.0, inertia_percent=4.0)
MASS, TENSOR = 5.0, np.diag([2.0, 3.0, 6.0])  # of the norm 7
AT_LIMIT = np.array([0.1, 0.003, 0.003, 0.003, *np.full(6, 0.28 / 3.0)])
"""Standard deviations: all six of the inertia alike, of which three count twice."""


def payload(deviations: np.ndarray) -> PayloadEstimate:
    return PayloadEstimate(MASS, np.zeros(3), TENSOR, np.diag(deviations**2))


def test_within_all_limits_it_is_and_each_one_counts() -> None:
    assert is_converged(payload(0.999 * AT_LIMIT), LIMITS)
    for number in range(10):
        deviations = 0.999 * AT_LIMIT
        deviations[number] *= 3.0
        assert not is_converged(payload(deviations), LIMITS), number


@pytest.mark.parametrize("limit", ["mass_percent", "com_mm", "inertia_percent"])
def test_a_limit_of_its_own_decides_on_each_part(limit: str) -> None:
    narrower = msgspec.structs.replace(LIMITS, **{limit: 0.99 * getattr(LIMITS, limit)})
    assert is_converged(payload(0.999 * AT_LIMIT), LIMITS)
    assert not is_converged(payload(0.999 * AT_LIMIT), narrower)


def test_what_is_not_known_is_not_converged() -> None:
    known = payload(0.1 * AT_LIMIT)
    assert not is_converged(msgspec.structs.replace(known, com=None), LIMITS)
    assert not is_converged(msgspec.structs.replace(known, tensor=None), LIMITS)


def test_the_inertia_is_as_uncertain_as_its_error_is_large() -> None:
    """Root mean square of the error's Frobenius norm, over errors drawn at random."""
    root = np.random.default_rng(1).normal(size=(10, 10))
    drawn = np.random.default_rng(2).normal(size=(20_000, 10)) @ root.T
    norms = [np.linalg.norm(unpack_symmetric(error[4:])) for error in drawn]
    assert inertia_std(root @ root.T) == pytest.approx(np.sqrt(np.mean(np.square(norms))), rel=0.02)
