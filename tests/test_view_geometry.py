"""Shapes of the view."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.app.view.geometry import (
    FOV,
    Stand,
    box_edges,
    ellipsoid,
    equivalent_box,
    extent,
    payload_boxes,
    place_under_ray,
    resting_place,
    rotation_to,
    stands,
    triangles_of,
    whole_team,
)
from coheft.estimation.geometry.spatial import rotation_exp
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.truth import BoxShape
from tests.estimation.team import random_pose
from tests.synthetic_run import SCENE

PLATE = BoxShape(size=(1.0, 0.7, 0.05), position=(0.0, 0.0, 0.0))
TOWER = BoxShape(size=(0.2, 0.2, 0.4), position=(0.3, 0.1, 0.2), rotation_deg=(0.0, 0.0, 30.0))
BODY = triangles_of([PLATE, TOWER])


def test_the_box_of_a_boxs_inertia_is_that_box():
    rng = np.random.default_rng(3)
    for _ in range(20):
        pose, size = random_pose(rng), rng.uniform(0.1, 2.0, 3)
        inertia = Inertia.of_box(rng.uniform(0.5, 20.0), size, pose)
        found_pose, found_size = equivalent_box(inertia)
        np.testing.assert_allclose(np.sort(found_size), np.sort(size), rtol=1e-9)
        assert np.linalg.det(found_pose.rotation) == pytest.approx(1.0)
        again = Inertia.of_box(inertia.mass, found_size, found_pose)
        np.testing.assert_allclose(again.tensor, inertia.tensor, atol=1e-9)
        np.testing.assert_allclose(again.com, inertia.com, atol=1e-12)


def test_an_inertia_that_no_body_has_still_has_a_picture():
    _, size = equivalent_box(Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 5.0])))
    assert np.isfinite(size).all()
    assert (size > 0.0).all()


def test_an_ellipsoid_has_the_covariance_that_it_shows():
    root = np.random.default_rng(4).normal(size=(3, 3))
    covariance = root @ root.T
    pose, half = ellipsoid(np.ones(3), covariance)
    np.testing.assert_allclose(pose.rotation @ np.diag((half / 3.0) ** 2) @ pose.rotation.T, covariance, atol=1e-12)
    np.testing.assert_array_equal(pose.translation, np.ones(3))


def test_a_box_has_twelve_edges_of_its_own_lengths():
    edges = box_edges(random_pose(np.random.default_rng(5)), np.array([1.0, 2.0, 3.0]))
    lengths = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    np.testing.assert_allclose(np.sort(lengths), np.repeat([1.0, 2.0, 3.0], 4))


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [1e-12, 0, -1], [0.3, -0.2, 0.5], [0, 0, 0]])
def test_a_link_points_where_it_should(direction):
    rotation = rotation_to(np.array(direction, dtype=np.float64))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    length = np.linalg.norm(direction)
    if length:
        np.testing.assert_allclose(rotation[:, 2], np.array(direction) / length, atol=1e-9)


def test_elbows_are_a_link_away_from_both_ends_and_above():
    stand = Stand(np.array([1.0, 0.0, 0.5]), 0.6)
    hand = np.array([0.2, 0.3, 0.8])
    elbow = stand.elbow(hand)
    assert np.linalg.norm(elbow - stand.shoulder) == pytest.approx(0.6)
    assert np.linalg.norm(elbow - hand) == pytest.approx(0.6)
    assert elbow[2] > hand[2]
    assert np.isfinite(stand.elbow(np.array([1.0, 0.0, 9.0]))).all(), "out of reach, straight up"


def test_every_robot_has_a_stand_outside_of_the_team():
    centre = SCENE.translations.mean(axis=0)
    for stand, hand in zip(stands(SCENE), SCENE.translations, strict=True):
        assert np.linalg.norm((stand.shoulder - centre)[:2]) > np.linalg.norm((hand - centre)[:2])


def test_a_payload_of_which_nobody_knows_the_shape_is_a_plate_between_the_hands():
    (box,) = payload_boxes(SCENE)
    middle = (SCENE.translations.min(axis=0) + SCENE.translations.max(axis=0)) / 2.0
    np.testing.assert_allclose(box.position, middle)


def test_a_click_hits_what_is_in_front():
    down = np.array([0.0, 0.0, -1.0])
    np.testing.assert_allclose(place_under_ray(BODY, np.array([0.3, 0.1, 5.0]), down), [0.3, 0.1, 0.4])
    np.testing.assert_allclose(place_under_ray(BODY, np.array([-0.3, 0.1, 5.0]), down), [-0.3, 0.1, 0.025])
    assert place_under_ray(BODY, np.array([2.0, 0.0, 5.0]), down) is None
    assert place_under_ray(BODY, np.array([0.0, 0.0, 5.0]), -down) is None
    slanted = rotation_exp([0.4, 0.0, 0.0]) @ down
    hit = place_under_ray(triangles_of([PLATE]), np.array([0.1, 0.0, 0.0]) - slanted, slanted)
    assert hit is not None
    assert hit[2] == pytest.approx(0.025)


def test_a_load_lies_on_top_of_what_was_hit():
    assert resting_place(BODY, np.array([-0.3, 0.1, 0.025]), 0.1) == pytest.approx((-0.3, 0.1, 0.075))
    side_of_tower = np.array([0.3, 0.05, 0.2])
    assert resting_place(BODY, side_of_tower, 0.1) == pytest.approx((0.3, 0.05, 0.45))


@pytest.mark.parametrize("aspect", [2.0, 0.84, 0.65, 0.46])
def test_however_narrow_the_window_all_robots_are_in_it_and_above_the_panel(aspect):
    size = extent(SCENE)
    middle = np.array(SCENE.home) + SCENE.translations.mean(axis=0) - [0.0, 0.0, 0.5 * size]
    look_at, position = whole_team(middle, size, aspect)
    forth = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forth, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forth)
    lowest = -1.0 if aspect > 0.62 else 0.2  # of the picture, from -1 at its lower edge to 1
    for stand in stands(SCENE):
        way = stand.shoulder - position
        depth = np.tan(0.5 * FOV) * (way @ forth)
        assert abs(way @ right) < aspect * depth
        assert lowest * depth < way @ up < depth
