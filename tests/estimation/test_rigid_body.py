"""Mass properties: their parametrisations agree with each other and with particles."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.rigid_body.mass_properties import (
    Inertia,
    combined,
    euler_regressor,
    inertia_operator,
    pack_symmetric,
    packed_rotation,
    unpack_symmetric,
)
from tests.rigid_motions import Particles, bodies, poses, rotations, vectors


def inertia_of(body: Particles) -> Inertia:
    return Inertia(float(body.masses.sum()), body.com(), body.tensor())


def assert_same(found: Inertia, expected: Inertia) -> None:
    np.testing.assert_allclose(found.mass, expected.mass, rtol=1e-12)
    np.testing.assert_allclose(found.com, expected.com, atol=1e-12)
    np.testing.assert_allclose(found.tensor, expected.tensor, atol=1e-10)


@given(vectors(5.0, 6))
def test_packing_round_trip(packed: Array) -> None:
    matrix = unpack_symmetric(packed)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_array_equal(pack_symmetric(matrix), packed)
    assert matrix[0, 1] == packed[3]
    assert matrix[0, 2] == packed[4]
    assert matrix[1, 2] == packed[5]


@given(vectors(5.0, 6), vectors(3.0))
def test_inertia_operator(packed: Array, x: Array) -> None:
    np.testing.assert_allclose(inertia_operator(x) @ packed, unpack_symmetric(packed) @ x, atol=1e-12)


@given(vectors(5.0, 6), vectors(3.0), vectors(3.0))
def test_euler_regressor(packed: Array, w: Array, alpha: Array) -> None:
    tensor = unpack_symmetric(packed)
    expected = tensor @ alpha + np.cross(w, tensor @ w)
    np.testing.assert_allclose(euler_regressor(w, alpha) @ packed, expected, atol=1e-12)
    both = euler_regressor(np.array([w, alpha]), np.array([alpha, w]))
    np.testing.assert_allclose(both[0] @ packed, expected, atol=1e-12)


@given(vectors(5.0, 6), rotations)
def test_packed_rotation(packed: Array, rotation: Array) -> None:
    turned = pack_symmetric(rotation @ unpack_symmetric(packed) @ rotation.T)
    np.testing.assert_allclose(packed_rotation(rotation) @ packed, turned, atol=1e-12)


@given(bodies)
def test_barycentric_round_trip(body: Particles) -> None:
    inertia = inertia_of(body)
    assert_same(Inertia.from_barycentric(inertia.barycentric()), inertia)


@given(bodies)
def test_barycentric_parameters_add_up_over_particles(body: Particles) -> None:
    points = [
        Inertia(float(mass), position, np.zeros((3, 3))).barycentric()
        for mass, position in zip(body.masses, body.positions, strict=True)
    ]
    np.testing.assert_allclose(np.sum(points, axis=0), inertia_of(body).barycentric(), atol=1e-11)


@given(bodies, vectors(3.0, 6))
def test_spatial_inertia_tells_kinetic_energy_and_momentum(body: Particles, twist: Array) -> None:
    velocities = twist[3:] + np.cross(twist[:3], body.positions)
    momenta = body.masses[:, None] * velocities
    spatial = inertia_of(body).spatial()
    np.testing.assert_allclose(0.5 * twist @ spatial @ twist, 0.5 * np.sum(momenta * velocities), atol=1e-10)
    angular = np.cross(body.positions, momenta).sum(axis=0)
    np.testing.assert_allclose(spatial @ twist, np.append(angular, momenta.sum(axis=0)), atol=1e-10)


@given(bodies)
def test_pseudo_inertia_is_the_second_moment_of_mass(body: Particles) -> None:
    pseudo_inertia = inertia_of(body).pseudo_inertia()
    points = np.column_stack([body.positions, np.ones(len(body.masses))])
    np.testing.assert_allclose(pseudo_inertia, points.T @ (body.masses[:, None] * points), atol=1e-11)
    assert np.linalg.eigvalsh(pseudo_inertia)[0] > -1e-11


def test_pseudo_inertia_tells_impossible_bodies() -> None:
    """Positive principal inertias do not make a body: two must add up to the third at least."""
    impossible = Inertia(1.0, np.zeros(3), np.diag([1.0, 1.0, 3.0]))
    assert np.linalg.eigvalsh(impossible.pseudo_inertia())[0] < -0.1


@given(bodies, bodies, poses)
def test_combined_bodies_follow_the_parallel_axis_theorem(first: Particles, second: Particles, pose: Pose) -> None:
    a, b = inertia_of(first), inertia_of(second).transported(pose)
    both = combined([a, b])
    com = (a.mass * a.com + b.mass * b.com) / (a.mass + b.mass)
    shifted = [body.tensor - body.mass * skew(body.com - com) @ skew(body.com - com) for body in (a, b)]
    assert_same(both, Inertia(a.mass + b.mass, com, shifted[0] + shifted[1]))


def test_box() -> None:
    box = Inertia.of_box(12.0, (1.0, 2.0, 3.0), Pose(np.eye(3), np.array([0.1, 0.2, 0.3])))
    assert_same(box, Inertia(12.0, np.array([0.1, 0.2, 0.3]), np.diag([13.0, 10.0, 5.0])))
