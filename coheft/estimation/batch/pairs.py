"""Grasp poses of a team with their joint covariance; from twists, pair by pair (Zhang et al., sec. III-B).

The poses of pairs do not agree around loops. The sum of their squared errors, weighted by their covariances, is
minimised over one pose per robot, which closes all loops (a pose graph: Lu and Milios 1997).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import msgspec
import numpy as np

from coheft.estimation.batch.signals import Signals
from coheft.estimation.batch.statistics import sandwich_information
from coheft.estimation.geometry.body_motion import BODY_W, perturbation_between, perturbed, relative_pose_derivative
from coheft.estimation.geometry.observability import PoseEstimate, SeenInformation
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.geometry.uncertain_pose import UncertainPose
from coheft.estimation.rigid_body.unobservable import middle_and_size

_ROTATION_STEP, _TRANSLATION_STEP = 1e-4, 1e-4
_TURNS = (2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0)
"""Rotations that represent an arbitrary one about an axis that is not observable [rad]."""
_AWAY = 10.0
"""Translation that represents an arbitrary one, in multiples of the size of the team."""
_TURNING = 0.1
"""Directions with a smaller rotational part are translations."""
_SINGULAR = 1e-12
"""Share of the largest singular value below which a direction of positions is not observable, and left zero."""
_FINEST = 1e-6
"""Twists below this are rounding [rad/s, m/s]."""
_STEPS, _CLOSE = 20, 1e-9
"""Gauss-Newton steps, and the step [rad, m] that ends them."""


@dataclass(frozen=True, eq=False)
class TeamPoses:
    """Poses of all robots' grasp frames.

    Attributes:
        poses: Poses in the reference robot's grasp frame, the first one.
        covariance: Covariance of all perturbations, shape (6 N, 6 N); zero for the first pose.
        is_settled: Whether the fit has converged.
    """

    poses: tuple[Pose, ...]
    covariance: Array
    is_settled: bool = True

    @property
    def is_observable(self) -> bool:
        """Whether all poses are observable."""
        return not any(self.relative(0, other).unobservable for other in range(1, len(self.poses)))

    @property
    def seen(self) -> tuple[Pose, ...]:
        """The first pose, and those that are observable."""
        return tuple(pose for k, pose in enumerate(self.poses) if not k or not self.relative(0, k).unobservable)

    def relative(self, i: int, j: int) -> PoseEstimate:
        """``pose_j_in_i`` of two different robots."""
        derivative = relative_pose_derivative(self.poses[i], self.poses[j])
        by_robot = self.covariance.reshape(len(self.poses), 6, len(self.poses), 6)
        covariance = derivative @ by_robot[[i, j]][:, :, [i, j]].reshape(12, 12) @ derivative.T
        seen = SeenInformation.of(np.linalg.inv(covariance).astype(np.float64))
        return PoseEstimate(self.poses[i].inverse() @ self.poses[j], covariance, seen.unobservable())


def unseen_covariance(solve: Callable[[Sequence[Pose]], Array], team: TeamPoses) -> Array:
    """Covariance (u, u) of a result (u,) due to directions of grasps that are not observable.

    Rotations are large, so that a derivative would not do: it is zero at a maximum, such as that of the sum of two
    forces that seem to be parallel. Translations are as large as noise makes them, which its covariance does not tell.
    """
    result = solve(team.poses)
    covariance = np.zeros((len(result), len(result)))
    away = _AWAY * middle_and_size(team.poses)[1]
    for robot in range(1, len(team.poses)):
        for direction in team.relative(0, robot).unobservable:
            size = float(np.linalg.norm(direction.rotation))
            if size < _TURNING:
                moves = [np.concatenate([np.zeros(3), away * direction.translation])]
            else:
                moves = [np.concatenate([turn / size * direction.rotation, np.zeros(3)]) for turn in _TURNS]
            for move in moves:
                moved = list(team.poses)
                moved[robot] = perturbed(moved[robot], move)
                change = solve(moved) - result
                covariance += np.outer(change, change)
    return covariance


def derivative_by_poses(solve: Callable[[Sequence[Pose]], Array], poses: Sequence[Pose]) -> Array:
    """Derivative (u, 6 N) of a result (u,) by the perturbations of all poses, by central differences.

    The columns of the first pose, which defines the frame, are zero.
    """
    columns = []
    steps = np.repeat([_ROTATION_STEP, _TRANSLATION_STEP], 3)
    for robot in range(1, len(poses)):
        for axis, step in zip(np.eye(6), steps, strict=True):
            moved = [
                solve([perturbed(pose, sign * step * axis) if k == robot else pose for k, pose in enumerate(poses)])
                for sign in (1.0, -1.0)
            ]
            columns.append((moved[0] - moved[1]) / (2.0 * step))
    result: Array = np.stack(columns, axis=1)
    return np.hstack([np.zeros((len(result), 6)), result])


def kabsch(w_i: Array, w_j: Array) -> Array:
    """Rotation ``R_ij`` (3, 3) that minimises the sum of ``|w_i - R w_j|^2``, vectors (n, 3) (Zhang et al., eq. 5)."""
    left, _, right = np.linalg.svd(w_i.T @ w_j)
    turn = np.array([1.0, 1.0, np.linalg.det(left) * np.linalg.det(right)])
    rotation: Array = (left * turn) @ right
    return rotation


def position_between(rotation: Array, w_i: Array, v_i: Array, v_j: Array, instrument: Array) -> Array:
    """Position ``p_ij`` (3,) of ``v_i - R v_j = p x w_i`` (Zhang et al., eqs 7, 8).

    With ``w_i`` itself as instrument this is least squares, which is too short by the share of noise in the square of
    ``w_i``; another sensor's measurement of the same angular velocity as instrument has no such bias.

    All vectors have the shape (n, 3): ``v_j`` in the axes of ``F_j``, the others in those of ``F_i``.
    """
    matrix = _levers(instrument, w_i)
    vector = np.cross(instrument, v_i - v_j @ rotation.T).sum(axis=0)
    largest = float(np.linalg.norm(matrix, 2))
    rounding = len(w_i) * _FINEST**2
    if largest <= rounding:
        return np.zeros(3)
    result: Array = np.linalg.lstsq(matrix, vector, rcond=max(_SINGULAR, rounding / largest))[0]
    return result


def _levers(instrument: Array, w_i: Array) -> Array:
    """Sum of ``[z]x^T [w]x = -[z]x [w]x`` (3, 3) over vectors (n, 3); ``p x w = -[w]x p``."""
    products = instrument.T @ w_i
    result: Array = np.trace(products) * np.eye(3) - products.T
    return result


def pair_pose(twist_i: Array, twist_j: Array, rate: float, instrument: Array | None = None) -> PoseEstimate:
    """``pose_j_in_i`` with its covariance, from twists ``(w, v)``, shape (n, 6) each.

    ``instrument`` is ``w_i`` as other robots measure it, shape (n, 3); None for plain least squares.
    """
    w_i, v_i, w_j, v_j = twist_i[:, :3], twist_i[:, 3:], twist_j[:, :3], twist_j[:, 3:]
    z = w_i if instrument is None else instrument
    rotation = kabsch(w_i, w_j)
    position = position_between(rotation, w_i, v_i, v_j, z)
    turned_w, turned_v = w_j @ rotation.T, v_j @ rotation.T
    residual = v_i - turned_v - np.cross(position, w_i)
    scores = np.hstack([np.cross(turned_w, w_i), np.cross(z, residual)])
    derivative = np.zeros((6, 6))
    derivative[:3, :3] = -_levers(w_i, turned_w)
    derivative[3:, :3], derivative[3:, 3:] = -_levers(z, turned_v), -_levers(z, w_i)
    least = np.zeros((6, 6))
    least[:3, :3], least[3:, 3:] = _FINEST**2 * _levers(turned_w, turned_w), _FINEST**2 * _levers(z, z)
    seen = SeenInformation.of(sandwich_information(derivative, scores, rate, least))
    return PoseEstimate(Pose(rotation, position), seen.inverse(), seen.unobservable())


def close_loops(count: int, pairs: Mapping[tuple[int, int], UncertainPose]) -> TeamPoses:
    """Poses of all robots in the first one's frame, from ``pose_j_in_i`` by ``(i, j)``; all of ``(0, j)`` are there."""
    poses = [Pose.identity(), *(pairs[0, j].pose for j in range(1, count))]
    weights = {pair: np.linalg.inv(estimate.covariance) for pair, estimate in pairs.items()}
    for _ in range(_STEPS):
        information, score = np.zeros((6 * count, 6 * count)), np.zeros(6 * count)
        for (i, j), estimate in pairs.items():
            own = relative_pose_derivative(poses[i], poses[j])
            derivative = np.zeros((6, 6 * count))
            derivative[:, 6 * i : 6 * i + 6], derivative[:, 6 * j : 6 * j + 6] = own[:, :6], own[:, 6:]
            error = perturbation_between(poses[i].inverse() @ poses[j], estimate.pose)
            information += derivative.T @ weights[i, j] @ derivative
            score += derivative.T @ weights[i, j] @ error
        covariance = np.zeros_like(information)
        covariance[6:, 6:] = np.linalg.inv(information[6:, 6:])
        step = (covariance @ score).reshape(count, 6)
        poses = [perturbed(pose, move) for pose, move in zip(poses, step, strict=True)]
        is_settled = bool(np.abs(step).max() < _CLOSE)
        if is_settled:
            break
    # The pairs share their robots' noise: N (N - 1) / 2 of them know no more than N - 1 independent ones.
    return TeamPoses(tuple(poses), covariance * (len(pairs) / (count - 1)), is_settled)


class LoopError(msgspec.Struct, frozen=True):
    """By how much a loop of three robots fails to close: the third one's pose by way of the second.

    Attributes:
        rotation_deg: Angle of the error [degrees].
        position_mm: Distance [mm].
        deviations: Root mean square of both, in standard deviations of the three pairs together.
    """

    rotation_deg: float
    position_mm: float
    deviations: float


def loop_errors(pairs: Mapping[tuple[int, int], UncertainPose]) -> list[LoopError]:
    """Errors of all loops of three robots whose pairs ``(i, j)``, ``i < j``, are all there."""
    errors = []
    for i, j, k in combinations(sorted({robot for pair in pairs for robot in pair}), 3):
        if not {(i, j), (j, k), (i, k)} <= set(pairs):
            continue
        first, second, both = pairs[i, j], pairs[j, k], pairs[i, k]
        turn = first.pose.rotation
        error = perturbation_between(both.pose, first.pose @ second.pose)
        by_first, by_second = Pose(np.eye(3), -turn @ second.pose.translation).adjoint(), np.kron(np.eye(2), turn)
        covariance = by_first @ first.covariance @ by_first.T + by_second @ second.covariance @ by_second.T
        covariance += both.covariance
        errors.append(
            LoopError(
                rotation_deg=float(np.degrees(np.linalg.norm(error[:3]))),
                position_mm=float(1e3 * np.linalg.norm(error[3:])),
                deviations=float(np.sqrt(error @ np.linalg.solve(covariance, error) / len(error))),
            )
        )
    return errors


def grasps_from_twists(signals: Signals, with_instruments: bool) -> tuple[TeamPoses, list[LoopError]]:
    """Poses of the team from its twists, and by how much loops of observable pairs failed to close."""
    pairs = _pairs(signals, with_instruments)
    seen = {pair: estimate for pair, estimate in pairs.items() if not estimate.unobservable}
    return close_loops(len(signals.motion), pairs), loop_errors(seen)


def expected_bias(signals: Signals, team: TeamPoses) -> Array:
    """Expected perturbations (6 N,) of the team by plain least squares, because noise of ``w`` is taken for rotation.

    Positions are too short by ``(W^T W)^-1 Q p``, with ``Q`` the part of ``W^T W`` that is noise, which follows from
    how much robots disagree. ``team`` has the poses by plain least squares; all are observable.
    """
    right = {}
    for (i, j), found in _pairs(signals, with_instruments=False).items():
        w = signals.motion[i][:, BODY_W]
        noise = w - _instrument(signals, i, j)
        # The instrument is the mean of others, which have noise as well.
        others = max(len(signals.motion) - 2, 1)
        share = others / (others + 1.0)
        matrix = _levers(w, w)
        position = np.linalg.solve(matrix - share * _levers(noise, noise), matrix @ found.pose.translation)
        right[i, j] = replace(found, pose=Pose(found.pose.rotation, position.astype(np.float64)))
    poses = close_loops(len(signals.motion), right).poses
    return np.concatenate([perturbation_between(true, own) for true, own in zip(poses, team.poses, strict=True)])


def _pairs(signals: Signals, with_instruments: bool) -> dict[tuple[int, int], PoseEstimate]:
    twists, pairs = signals.twists, {}
    for i, j in combinations(range(len(twists)), 2):
        instrument = _instrument(signals, i, j) if with_instruments else None
        pairs[i, j] = pair_pose(twists[i], twists[j], signals.rate, instrument)
    return pairs


def _instrument(signals: Signals, i: int, j: int) -> Array:
    """Mean ``w_i`` as measured by the robots outside the pair; in a team of two, by robot j."""
    w = signals.motion[..., BODY_W]
    third = [k for k in range(len(w)) if k not in (i, j)] or [j]
    result: Array = np.mean([w[k] @ kabsch(w[i], w[k]).T for k in third], axis=0)
    return result
