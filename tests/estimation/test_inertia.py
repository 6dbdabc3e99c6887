"""The linear model of inertia, and which motion would show what is not seen of a load."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.estimation.rigid_body.regressor import features, regressor_coefficients, spatial_inertia
from coheft.estimation.rigid_body.unobservable import Unobservable, middle_and_size, unobservable_quantities
from tests.estimation.team import Team, make_team

MASS, LENGTH = 8.0, 0.5


def true_wrench(team: Team) -> Array:
    return team.inertia.wrench(team.motion[:, 0:3], team.motion[:, 6:9], team.motion[:, 9:12])


@pytest.mark.parametrize("with_offset", [False, True])
def test_the_regressor_gives_the_wrench_of_newton_and_euler(with_offset: bool) -> None:
    team, offset = make_team(seed=1, duration=1.0), np.arange(1.0, 7.0) * with_offset
    found = features(team.motion, true_wrench(team) + offset)
    unknowns = np.concatenate([team.inertia.barycentric(), offset[: 6 * with_offset]])
    residuals = np.tensordot(found, regressor_coefficients(with_offset), axes=1) @ np.append(unknowns, -1.0)
    np.testing.assert_allclose(residuals, 0.0, atol=1e-9)


def test_spatial_inertia_gives_the_wrench_of_a_body_that_does_not_turn_yet() -> None:
    team, rng = make_team(seed=2, duration=0.1), np.random.default_rng(2)
    a, alpha = rng.normal(size=(2, 4, 3))
    expected = team.inertia.wrench(np.zeros((4, 3)), a, alpha)
    found = np.hstack([a, alpha]) @ spatial_inertia(team.inertia.barycentric()).T
    np.testing.assert_allclose(found, expected, atol=1e-12)


def covariance(mass: float = 0.01, com: Array | None = None, inertia: Array | None = None) -> Array:
    """Of ``(m, h, J)``; everything is seen but what is given, as shares of the scale."""
    result = np.diag(np.repeat([mass * MASS, 0.01 * LENGTH, 0.01 * MASS * LENGTH**2], [1, 3, 6]) ** 2)
    if com is not None:
        result[1:4, 1:4] += LENGTH**2 * np.outer(com, com)
    if inertia is not None:
        packed = pack_symmetric(inertia)
        result[4:, 4:] += (MASS * LENGTH**2) ** 2 * np.outer(packed, packed)
    return result


def unobservable(covariance: Array) -> tuple[Unobservable, ...]:
    return unobservable_quantities(covariance, MASS, LENGTH)


def test_what_is_known_well_is_seen() -> None:
    assert unobservable(covariance()) == ()


def test_the_mass_is_unobservable_if_it_may_be_wrong_by_half() -> None:
    (found,) = unobservable(covariance(mass=0.5))
    assert (found.quantity, found.what) == ("mass", "mass")


def test_an_axis_along_which_the_centre_of_mass_may_be_anywhere_is_named() -> None:
    (found,) = unobservable(covariance(com=np.array([0.6, -0.8, 0.0])))
    assert (found.quantity, found.what) == ("com", "centre of mass along (-0.60, 0.80, 0.00)")
    assert found.remedy == "tilt the load, or turn it about an axis across that direction"


def test_turning_about_one_axis_hides_the_inertia_about_the_others() -> None:
    """A body that turns about z shows the third column of the inertia alone."""
    hidden = sum(covariance(inertia=np.outer(one, other) + np.outer(other, one)) for one, other in ALL_BUT_Z)
    found = unobservable(hidden / len(ALL_BUT_Z))
    assert {each.quantity for each in found} == {"inertia"}
    assert len(found) == 2
    assert all(each.what.endswith("0.00)") and "about" in each.what for each in found)
    assert found[0].remedy == "turn the load faster about that axis"


X, Y = np.eye(3)[:2]
ALL_BUT_Z = [(X, X), (Y, Y), (X, Y)]


def test_a_product_of_inertia_alone_is_named() -> None:
    (found,) = unobservable(covariance(inertia=np.outer(X, Y) + np.outer(Y, X)))
    assert (found.quantity, found.what) == ("inertia", "products of inertia")


def test_a_load_is_guessed_where_robots_hold_it_and_not_too_small() -> None:
    places = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.6, 0.0]])
    middle, size = middle_and_size([Pose(np.eye(3), place) for place in places])
    np.testing.assert_allclose(middle, [0.5, 0.2, 0.0])
    assert size == pytest.approx(np.sqrt(np.mean(np.sum((places - middle) ** 2, axis=1))))
    assert middle_and_size([Pose.identity()])[1] == 0.25
