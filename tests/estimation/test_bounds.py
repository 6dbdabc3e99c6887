"""The joint bound against finite differences, against the full problem, and against maximum likelihood."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import chdtri

from coheft.estimation import bounds
from coheft.estimation.bounds import JointBound, JointInformation
from coheft.estimation.geometry.body_motion import (
    grasp_derivatives,
    grasp_measurements,
    perturbation_between,
    perturbed,
    relative_pose_derivative,
)
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body import derivatives as inertia_derivatives
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.estimation.tolerance import SensorTolerance
from tests.estimation.team import Team, make_team, random_pose


def finite_difference(function: Callable[[Array], Array], size: int, step: float = 1e-6) -> Array:
    """Central differences at zero; the derivative's last axis is the argument's."""
    columns = [(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(size)]
    return np.stack(columns, axis=-1)


def moved_inertia(inertia: Inertia, change: Array) -> Inertia:
    m, h, packed = np.split(inertia.central() + change, [1, 4])
    return Inertia(float(m[0]), h, unpack_symmetric(packed))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture
def inertia() -> Inertia:
    return make_team(0, duration=0.1).inertia


def test_grasp_derivatives(rng: np.random.Generator) -> None:
    pose, motion = random_pose(rng), rng.normal(size=(5, 12))
    by_pose, by_motion = grasp_derivatives(pose, motion)
    numeric = finite_difference(lambda d: grasp_measurements(perturbed(pose, d), motion), 6)
    np.testing.assert_allclose(by_pose, numeric, atol=1e-8)
    numeric = finite_difference(lambda d: grasp_measurements(pose, motion + d), 12)
    np.testing.assert_allclose(by_motion, numeric, atol=1e-8)


def test_relative_pose_derivative(rng: np.random.Generator) -> None:
    pose_i, pose_j = random_pose(rng), random_pose(rng)
    nominal = pose_i.inverse() @ pose_j

    def relative(d: Array) -> Array:
        return perturbation_between(nominal, perturbed(pose_i, d[:6]).inverse() @ perturbed(pose_j, d[6:]))

    np.testing.assert_allclose(relative_pose_derivative(pose_i, pose_j), finite_difference(relative, 12), atol=1e-8)


def test_wrench_derivatives(rng: np.random.Generator, inertia: Inertia) -> None:
    pose, wrenches, motion = random_pose(rng), rng.normal(size=(5, 6)), rng.normal(size=(5, 12))
    numeric = finite_difference(lambda d: wrenches @ perturbed(pose, d).adjoint().T, 6)
    np.testing.assert_allclose(bounds.carried_wrench_derivative(pose, wrenches), numeric, atol=1e-8)

    def total(moved: Inertia, motion: Array) -> Array:
        return moved.wrench(motion[:, :3], motion[:, 6:9], motion[:, 9:])

    np.testing.assert_allclose(
        bounds.wrench_regressor(motion) @ inertia.barycentric(), total(inertia, motion), atol=1e-11
    )
    numeric = finite_difference(lambda d: total(inertia, motion + d), 12)
    np.testing.assert_allclose(bounds.wrench_derivative(inertia, motion), numeric, atol=1e-6)
    numeric = finite_difference(lambda d: moved_inertia(inertia, d).barycentric(), 10)
    np.testing.assert_allclose(inertia_derivatives.barycentric_derivative(inertia), numeric, atol=1e-6)


def test_seen_inertia_derivative(rng: np.random.Generator, inertia: Inertia) -> None:
    pose = random_pose(rng)

    def seen(d: Array) -> Array:
        return moved_inertia(inertia, d[6:]).transported(perturbed(pose, d[:6]).inverse()).central()

    np.testing.assert_allclose(
        inertia_derivatives.seen_inertia_derivative(pose, inertia), finite_difference(seen, 16), atol=1e-7
    )


class FullProblem:
    """Everything unknown at once, nothing eliminated: poses, inertia, motions, all wrenches but the first robot's.

    The first robot's wrench is what the others leave to do. Whitened residuals; unknowns are changes from the truth.
    """

    def __init__(self, team: Team) -> None:
        self.team = team
        self.n, self.count = team.exact.shape[:2]
        self.parameters = 6 * (self.count - 1) + 10
        self.size = self.parameters + 12 * self.n + 6 * self.n * (self.count - 1)

    def model(self, change: Array) -> Array:
        """Noise-free samples (n, N, 15), and with them ``change`` (size,) of all unknowns."""
        team, n = self.team, self.n
        poses, inertia = self.moved(change[: self.parameters])
        motion_change, wrench_change = np.split(change[self.parameters :], [12 * n])
        motion = team.motion + motion_change.reshape(n, 12)
        samples = np.empty_like(team.exact)
        samples[:, 1:, 9:] = team.exact[:, 1:, 9:] + wrench_change.reshape(n, -1, 6)
        missing = inertia.wrench(motion[:, :3], motion[:, 6:9], motion[:, 9:])
        for i, pose in enumerate(poses):
            samples[:, i, :9] = grasp_measurements(pose, motion)
            if i > 0:
                missing = missing - samples[:, i, 9:] @ pose.adjoint().T
        samples[:, 0, 9:] = missing
        return samples

    def moved(self, change: Array) -> tuple[list[Pose], Inertia]:
        steps = np.vstack([np.zeros(6), change[:-10].reshape(-1, 6)])
        poses = [perturbed(pose, step) for pose, step in zip(self.team.poses, steps, strict=True)]
        return poses, moved_inertia(self.team.inertia, change[-10:])

    def whitened(self, change: Array) -> Array:
        return (self.model(change) / self.team.noise.per_column()).ravel()

    def jacobian(self) -> Array:
        return finite_difference(self.whitened, self.size, 1e-5)


@pytest.fixture(scope="module")
def small() -> tuple[Team, FullProblem, Array]:
    """Three robots, twelve samples, and noise small enough for second-order effects not to count."""
    team = make_team(5, count=3, rate=8.0, duration=1.5, noise=SensorNoise().scaled(0.01), squeeze=20.0)
    problem = FullProblem(team)
    return team, problem, problem.jacobian()


def test_bound_is_the_inverse_information_of_the_full_problem(small: tuple[Team, FullProblem, Array]) -> None:
    team, problem, jacobian = small
    bound = JointInformation.of(team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise).full_bound()
    triangle = np.linalg.qr(jacobian, mode="r")
    full = np.linalg.inv(triangle)
    expected = (full @ full.T)[: problem.parameters, : problem.parameters]
    scale = 1.0 / np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        bound.covariance[6:, 6:] * np.outer(scale, scale), expected * np.outer(scale, scale), atol=1e-4
    )
    assert not bound.covariance[:6].any()


TOLERANCES = [
    SensorTolerance(gyro_offset=1e-4, velocity_offset=1e-3, acceleration_offset=1e-3),
    SensorTolerance(force_offset=0.01, torque_offset=1e-3, force_gain=1e-3, torque_gain=1e-3),
    SensorTolerance(gyro_offset=1e-4, force_offset=0.01, torque_gain=1e-3),
    SensorTolerance(gyro_scale=1e-3, acceleration_mounting_deg=0.1, velocity_cross_talk=1e-3, force_scale=1e-3),
]


def assert_bound_is_inverse(
    bound: JointBound, problem: FullProblem, jacobian: Array, columns: list[Array], deviations: list[float]
) -> None:
    """Of the problem with these columns more, which are unknowns with these prior deviations."""
    extended = np.block(
        [
            [jacobian, np.array(columns).T],
            [np.zeros((len(columns), problem.size)), np.diag(1.0 / np.array(deviations))],
        ]
    )
    full = np.linalg.inv(np.linalg.qr(extended, mode="r"))
    expected = (full @ full.T)[: problem.parameters, : problem.parameters]
    scale = 1.0 / np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        bound.covariance[6:, 6:] * np.outer(scale, scale), expected * np.outer(scale, scale), atol=3e-4
    )


@pytest.mark.parametrize("tolerance", TOLERANCES, ids=["kinematics", "wrenches", "some", "proportional"])
def test_errors_of_sensors_are_unknowns_with_a_prior(
    small: tuple[Team, FullProblem, Array], tolerance: SensorTolerance
) -> None:
    team, problem, jacobian = small
    bound = JointInformation.of(
        team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise, tolerance
    ).full_bound()
    offsets = [(slice(k, k + 1), None, deviation) for k, deviation in enumerate(tolerance.offsets()) if deviation > 0.0]
    columns, deviations = [], []
    for robot in range(problem.count):
        for place, matrix, deviation in (*offsets, *tolerance.proportional()):
            error, own = np.zeros_like(team.exact), team.exact[:, robot, place]
            error[:, robot, place] = 1.0 if matrix is None else own @ matrix.T
            columns.append((error / team.noise.per_column()).ravel())
            deviations.append(deviation)
    assert_bound_is_inverse(bound, problem, jacobian, columns, deviations)


def test_places_delays_and_compliance_are_unknowns_with_a_prior(small: tuple[Team, FullProblem, Array]) -> None:
    team, problem, jacobian = small
    told = SensorTolerance(
        velocity_place=0.01, acceleration_place=0.003, clock=1e-3, wrench_delay=2e-3, grasp_compliance=1e-4
    )
    rng, wrenches = np.random.default_rng(4), team.exact[:, :, 9:]
    motion_rates, wrench_rates = rng.normal(size=team.motion.shape), 20.0 * rng.normal(size=wrenches.shape)
    flexing = 100.0 * rng.normal(size=wrenches.shape)
    bound = JointInformation.of(
        team.poses, team.inertia, team.motion, wrenches, team.noise, told, (motion_rates, wrench_rates, flexing)
    ).full_bound()
    columns, deviations, h = [], [], 1e-5
    for robot, pose in enumerate(team.poses):

        def effect(change: Array, robot: int = robot) -> None:
            error = np.zeros_like(team.exact)
            error[:, robot] = change
            columns.append((error / team.noise.per_column()).ravel())

        at_grasp = grasp_measurements(pose, team.motion)
        for deviation, part in ((told.velocity_place, slice(3, 6)), (told.acceleration_place, slice(6, 9))):
            for axis in h * pose.rotation.T:
                there = grasp_measurements(Pose(pose.rotation, pose.translation + axis), team.motion)
                change = np.zeros((len(there), 15))
                change[:, part] = (there - at_grasp)[:, part] / h
                effect(change)
                deviations.append(deviation)
        effect(np.hstack([np.zeros((len(at_grasp), 3)), flexing[:, robot], np.zeros((len(at_grasp), 6))]))
        deviations.append(told.grasp_compliance)
        later = grasp_measurements(pose, team.motion + h * motion_rates) - at_grasp
        late_wrench = np.hstack([np.zeros((len(at_grasp), 9)), -wrench_rates[:, robot]])
        effect(np.hstack([-later / h, -wrench_rates[:, robot]]))
        effect(late_wrench)
        deviations += [told.clock, told.wrench_delay]
    assert_bound_is_inverse(bound, problem, jacobian, columns, deviations)


@pytest.mark.parametrize("told", [SensorTolerance(clock=1e-3), SensorTolerance(grasp_compliance=1e-5)])
def test_what_needs_rates_is_refused_without_them(
    small: tuple[Team, FullProblem, Array], told: SensorTolerance
) -> None:
    team = small[0]
    with pytest.raises(ValueError, match="expected rates, found None"):
        JointInformation.of(team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise, told)


def test_maximum_likelihood_reaches_the_bound(small: tuple[Team, FullProblem, Array]) -> None:
    team, problem, jacobian = small
    bound = JointInformation.of(team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise).full_bound()
    solve = np.linalg.pinv(jacobian)
    rng = np.random.default_rng(0)
    runs = 400
    pose_errors, inertia_errors = [], []
    for _ in range(runs):
        data = (team.measured(rng) / team.noise.per_column()).ravel()
        change = np.zeros(problem.size)
        for _ in range(4):
            change = change + solve @ (data - problem.whitened(change))
        poses, inertia = problem.moved(change[: problem.parameters])
        true_pose = team.poses[1].inverse() @ team.poses[2]
        pose_errors.append(perturbation_between(true_pose, poses[1].inverse() @ poses[2]))
        seen = [body.transported(pose.inverse()) for body, pose in ((inertia, poses[2]), (team.inertia, team.poses[2]))]
        inertia_errors.append(seen[0].central() - seen[1].central())
    for errors, covariance in (
        (np.array(pose_errors), bound.relative_pose(1, 2)),
        (np.array(inertia_errors), bound.inertia_seen_from(2)),
    ):
        nees = np.einsum("ri,ij,rj->", errors, np.linalg.inv(covariance), errors)
        low, high = chdtri(errors.size, [1.0 - 1e-4, 1e-4])
        assert low < nees < high
        np.testing.assert_allclose(errors.std(axis=0), np.sqrt(np.diag(covariance)), rtol=0.16)


def test_two_steps_bound(small: tuple[Team, FullProblem, Array]) -> None:
    """Poses from kinematics, then inertia given these poses, in the full problem linearised at the truth."""
    team, problem, jacobian = small
    wrenches = team.exact[:, :, 9:]
    bound = JointInformation.of(team.poses, team.inertia, team.motion, wrenches, team.noise).two_step_bound()
    poses = 6 * (problem.count - 1)
    kinematic = np.tile(np.arange(15) < 9, problem.n * problem.count)
    first = np.r_[0:poses, problem.parameters : problem.parameters + 12 * problem.n]
    pose_step = np.zeros((poses, len(jacobian)))
    pose_step[:, kinematic] = np.linalg.pinv(jacobian[kinematic][:, first])[:poses]
    given = np.linalg.pinv(jacobian[:, poses:])[:10]
    inertia_step = given @ (np.eye(len(jacobian)) - jacobian[:, :poses] @ pose_step)
    steps = np.vstack([pose_step, inertia_step])
    expected = steps @ steps.T
    scale = 1.0 / np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        bound.covariance[6:, 6:] * np.outer(scale, scale), expected * np.outer(scale, scale), atol=1e-4
    )


def test_knowing_more_never_hurts() -> None:
    team = make_team(2, duration=2.0)
    data = (team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise)
    information = JointInformation.of(*data)
    joint = information.full_bound()
    first, rest = (
        JointInformation.of(team.poses, team.inertia, team.motion[rows], team.exact[rows, :, 9:], team.noise)
        for rows in (slice(100), slice(100, None))
    )
    together = first + rest
    np.testing.assert_allclose(together.all_sensors, information.all_sensors, rtol=1e-9, atol=1e-3)
    for other in ((first.with_another_load() + rest).full_bound(), information.two_step_bound()):
        for worse, better in (
            (other.relative_pose(2, 4), joint.relative_pose(2, 4)),
            (other.inertia_seen_from(3), joint.inertia_seen_from(3)),
        ):
            scale = 1.0 / np.sqrt(np.diag(worse))
            assert np.linalg.eigvalsh((worse - better) * np.outer(scale, scale)).min() > -1e-9


def test_of_another_load_nothing_is_known_but_poses_are() -> None:
    team = make_team(2, duration=2.0)
    information = JointInformation.of(team.poses, team.inertia, team.motion, team.exact[:, :, 9:], team.noise)
    new = information.with_another_load().full_bound()
    assert np.diag(new.inertia_seen_from(0)).min() > 1e6
    full, two_step = information.full_bound(), information.two_step_bound()
    np.testing.assert_allclose(new.relative_pose(1, 5), full.relative_pose(1, 5), rtol=1e-6)
    assert (np.diag(full.relative_pose(1, 5)) < 0.9 * np.diag(two_step.relative_pose(1, 5))).any()


def test_shapes_are_checked() -> None:
    team = make_team(2, duration=0.5)
    with pytest.raises(ValueError, match=r"expected \(n, 12\)"):
        JointInformation.of(team.poses, team.inertia, team.motion[:, :9], team.exact[:, :, 9:], team.noise)
