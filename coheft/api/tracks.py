"""Estimates of one robot over time with the truth, as arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from coheft.app.results.errors import in_full
from coheft.app.results.judge import Judge, standard_deviations
from coheft.app.results.states import State
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.wire.messages.structs import Estimate, PayloadEstimate, Validity


@dataclass(frozen=True, eq=False, repr=False)
class Track:
    """A quantity at n times. All arrays have the same shape; NaN where the robot had no estimate.

    Attributes:
        truth: The true values, which no robot knew.
        estimate: The robot's estimates.
        std: The robot's own standard deviation of each number.
    """

    truth: Array
    estimate: Array
    std: Array

    def __repr__(self) -> str:
        last = f", last {_numbers(self.estimate[-1])} ± {_numbers(self.std[-1])}" if len(self.estimate) else ""
        return f"Track({' × '.join(map(str, self.estimate.shape))}{last})"

    @property
    def error(self) -> Array:
        """Estimate minus truth."""
        return self.estimate - self.truth


@dataclass(frozen=True, eq=False, repr=False)
class PoseTrack:
    """Pose of a neighbour's grasp frame ``F_j`` in the robot's own ``F_i`` at n times; NaN while it is unknown.

    Attributes:
        truth: Homogeneous matrix, shape (4, 4) [m].
        estimate: Homogeneous matrices, shape (n, 4, 4) [m].
        error: Truth minus estimate: rotation vector in the axes of ``F_i`` [rad], translation [m], shape (n, 6).
        std: The robot's own standard deviation of these, shape (n, 6).
    """

    truth: Array
    estimate: Array
    error: Array
    std: Array

    def __repr__(self) -> str:
        last = f", last at {_numbers(self.estimate[-1, :3, 3])} m" if len(self.estimate) else ""
        return f"PoseTrack({len(self.estimate)} poses{last})"


@dataclass(frozen=True, eq=False, repr=False)
class RobotResult:
    """All estimates of one robot, in its own grasp frame ``F_i``, at n times, about ten per second.

    Attributes:
        time: Times of the estimates, shape (n,) [s].
        state: State of the robot, shape (n,), as in ``coheft.State``.
        valid: Whether the estimate was valid, shape (n,).
        converged: Whether it had also converged, shape (n,).
        mass: Mass, shape (n,) [kg].
        com: Centre of mass, shape (n, 3) [m].
        inertia: Inertia about the centre of mass, shape (n, 3, 3) [kg·m²].
        poses: Poses of the neighbours' grasp frames, by name.
        noticed: Times at which it noticed changes of the load, shape (k,) [s].
    """

    time: Array
    state: npt.NDArray[np.str_]
    valid: npt.NDArray[np.bool_]
    converged: npt.NDArray[np.bool_]
    mass: Track
    com: Track
    inertia: Track
    poses: dict[str, PoseTrack]
    noticed: Array

    def __repr__(self) -> str:
        if not len(self.time):
            return "RobotResult(no estimates)"
        end = f"{self.time[-1]:g} s, {self.state[-1]}"
        return f"RobotResult({len(self.time)} estimates until {end}; mass {_numbers(self.mass.estimate[-1])} kg)"


def robot_result(judge: Judge, robot: str, kept: Sequence[tuple[Estimate, Inertia]]) -> RobotResult:
    """Collect the estimates of a robot in arrays.

    ``kept`` has its estimates in order of time, each with the true payload in the robot's frame.
    """
    estimates = [estimate for estimate, _ in kept]
    rows = [(truth.central(), *_central(estimate.payload)) for estimate, truth in kept]
    true, believed, std = np.array(rows).reshape(-1, 3, 10).transpose(1, 0, 2)
    mass, com, packed = (
        [part[:, columns] for part in (true, believed, std)] for columns in (0, slice(1, 4), slice(4, 10))
    )
    neighbours, off = judge.scene.neighbours.get(robot, []), [judge.pose_errors(estimate) for estimate in estimates]
    return RobotResult(
        time=np.array([estimate.time for estimate in estimates]),
        state=np.array([str(State.of(estimate)) for estimate in estimates], dtype=np.str_),
        valid=np.array([estimate.status is Validity.VALID for estimate in estimates], dtype=np.bool_),
        converged=np.array([estimate.is_converged for estimate in estimates], dtype=np.bool_),
        mass=Track(*mass),
        com=Track(*com),
        inertia=Track(*map(unpack_symmetric, packed)),
        poses={name: _pose_track(judge.relative_pose(robot, name), name, estimates, off) for name in neighbours},
        noticed=np.array([notice.noticed_at for notice in estimates[-1].load_changes] if estimates else []),
    )


def _central(payload: PayloadEstimate | None) -> tuple[Array, Array]:
    """Return ``(m, h, J packed)`` and its standard deviations, shape (10,) each, NaN where it is not known."""
    if payload is None:
        return np.full(10, np.nan), np.full(10, np.nan)
    com = np.zeros(3) if payload.com is None else payload.com
    tensor = np.zeros((3, 3)) if payload.tensor is None else payload.tensor
    known = Inertia(payload.mass, com, tensor).central()[: len(payload.covariance)]
    return in_full(known), in_full(standard_deviations(payload))


def _pose_track(
    truth: Pose, neighbour: str, estimates: Sequence[Estimate], off: Sequence[Mapping[str, Array]]
) -> PoseTrack:
    """Return the track of a neighbour's pose; ``off`` has the errors of all neighbours' poses of each estimate."""
    matrices, errors, stds = (np.full((len(estimates), *shape), np.nan) for shape in ((4, 4), (6,), (6,)))
    for k, (estimate, of_estimate) in enumerate(zip(estimates, off, strict=True)):
        if neighbour in of_estimate:
            found = estimate.poses[neighbour]
            matrices[k] = _matrix(Pose(found.rotation, found.translation))
            errors[k], stds[k] = of_estimate[neighbour], np.sqrt(np.diagonal(found.covariance))
    return PoseTrack(_matrix(truth), matrices, errors, stds)


def _matrix(pose: Pose) -> Array:
    """Return the homogeneous matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = pose.rotation, pose.translation
    return matrix


def _numbers(values: npt.ArrayLike) -> str:
    """Return numbers to four significant digits, in one line."""
    text = np.array2string(np.asarray(values), separator=", ", formatter={"float_kind": "{:.4g}".format})
    return text.replace("\n", "")
