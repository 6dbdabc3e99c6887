"""Three ways from a recording to the load: as the paper does it, with instruments, and from poses alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.body import body_motions, total_wrench
from coheft.estimation.batch.holds import Holds, holds_of, static_estimate
from coheft.estimation.batch.inertia_fit import fit_parameters, fit_tensor
from coheft.estimation.batch.loop_closure import close_loops, loop_errors
from coheft.estimation.batch.pairs import kabsch, pair_pose
from coheft.estimation.batch.payload import (
    Payload,
    central_numbers,
    derivative_by_poses,
    make_payload,
    of_central_numbers,
)
from coheft.estimation.batch.recording import Recording, check_recording
from coheft.estimation.batch.signals import Signals, signals_of
from coheft.estimation.inertia_derivatives import barycentric_derivative
from coheft.estimation.observability import PoseEstimate
from coheft.estimation.rigid_body import Inertia
from coheft.estimation.spatial import Array, Pose
from coheft.estimation.team_registration import TeamPoses

PAPER_CUTOFF = 5.0
"""Of the filter for plain least squares, which is biased the more, the higher it is [Hz]."""
CUTOFF = 3.0
"""Of the filter for unbiased methods: above, there is hardly any motion [Hz]."""

_ALL_DIRECTIONS = 6


@dataclass(frozen=True, eq=False)
class CalibrationFinding:
    """One thing that may be wrong with a robot.

    Attributes:
        robot: Whose.
        what: Which.
        unit: Of the numbers.
        value: What was found.
        std: How well it is known now,
        before: and how well it was before anything was measured.
    """

    robot: str
    what: str
    unit: str
    value: float
    std: float
    before: float

    @property
    def is_seen(self) -> bool:
        """Whether the recording said anything about it worth mentioning."""
        return self.std < 0.5 * self.before


@dataclass(frozen=True, eq=False)
class Identification:
    """What a recording says.

    Attributes:
        method: How it was found.
        names: Of the robots; the first one's grasp frame is what all is given in.
        team: Poses of all grasp frames.
        payload: Mass properties.
        loops: Failures of loops of pairs to close, before they were made to, shape (6,) each [rad, m].
        holds: What was measured at rest; None if not used.
        calibration: What may be wrong with the robots.
        remarks: What the reader should know, in words.
        time: Of the residuals, shape (n,) [s].
        residual: Of the total wrench (force, torque), or of the torque alone, shape (n, 6) or (n, 3).
    """

    method: str
    names: tuple[str, ...]
    team: TeamPoses
    payload: Payload
    loops: tuple[Array, ...] = ()
    holds: Holds | None = None
    calibration: tuple[CalibrationFinding, ...] = ()
    remarks: tuple[str, ...] = ()
    time: Array = field(default_factory=lambda: np.zeros(0))
    residual: Array = field(default_factory=lambda: np.zeros((0, 3)))

    @property
    def unseen(self) -> tuple[str, ...]:
        """What the motion does not show, in words."""
        sentences = []
        for k, name in enumerate(self.names[1:], 1):
            directions = self.team.relative(0, k).unseen
            if len(directions) == _ALL_DIRECTIONS:
                sentences.append(f"pose of {name}: the load has to move and turn")
            elif directions:
                parts = ", ".join(str(direction) for direction in directions)
                sentences.append(f"pose of {name}, {parts}: turn the load about other axes as well")
        return (*sentences, *self.payload.unseen)


def identify_batch(recording: Recording, cutoff: float = PAPER_CUTOFF) -> Identification:
    """The paper's way (Zhang et al., sec. III): least squares, one thing after the other.

    Raises:
        RecordingError: Something is missing; no two orientations were held still.
    """
    signals = _moving(recording, cutoff)
    team, loops = grasps_from_twists(signals, with_instruments=False)
    holds = holds_of(recording)
    wrench = _wrench(signals)

    def solve(poses: Sequence[Pose], shift: Array | None = None) -> Array:
        static = static_estimate(holds, poses)
        com = static.com if shift is None else static.com + shift
        tensor = fit_tensor(_motion(signals), total_wrench(wrench, poses), com, signals.rate)
        return np.concatenate([[static.mass], com, tensor.solution])

    static = static_estimate(holds, team.poses)
    tensor = fit_tensor(_motion(signals), total_wrench(wrench, team.poses), static.com, signals.rate)
    numbers = np.concatenate([[static.mass], static.com, tensor.solution])
    by_com = np.zeros((10, 4))
    by_com[0, 0] = 1.0
    for axis, column in enumerate(np.eye(3)):
        by_com[:, 1 + axis] = (solve(team.poses, 1e-4 * column) - solve(team.poses, -1e-4 * column)) / 2e-4
    by_poses = derivative_by_poses(solve, team.poses)
    covariance = by_com @ static.covariance @ by_com.T + by_poses @ team.covariance @ by_poses.T
    covariance[4:, 4:] += tensor.covariance
    return Identification(
        method="batch",
        names=recording.names,
        team=team,
        payload=make_payload(of_central_numbers(numbers), covariance, team.poses),
        loops=tuple(loops),
        holds=holds,
        remarks=(
            "Least squares takes noise of accelerations for motion: inertias come out too small, and nothing here "
            "says by how much. Compare with --method instruments.",
        ),
        time=signals.time,
        residual=tensor.residual,
    )


def identify_with_instruments(recording: Recording, cutoff: float = CUTOFF) -> Identification:
    """Twists as in the paper, but each robot's with the others' as instruments; mass and centre of mass from motion.

    Raises:
        RecordingError: Something is missing.
    """
    signals = _moving(recording, cutoff)
    team, loops = grasps_from_twists(signals, with_instruments=True)
    fit = parameters_fit(signals, team.poses)
    by_poses = derivative_by_poses(lambda poses: parameters_fit(signals, poses).numbers, team.poses)
    covariance = fit.covariance + by_poses @ team.covariance @ by_poses.T
    return Identification(
        method="instruments",
        names=recording.names,
        team=team,
        payload=make_payload(of_central_numbers(fit.numbers), covariance, team.poses),
        loops=tuple(loops),
        time=signals.time,
        residual=fit.residual,
    )


@dataclass(frozen=True, eq=False)
class ParametersFit:
    """``(m, h, J)`` (10,) in the first robot's frame, its covariance given poses, and the residual wrench (n, 6)."""

    numbers: Array
    covariance: Array
    residual: Array


def parameters_fit(signals: Signals, poses: Sequence[Pose]) -> ParametersFit:
    """All ten parameters from motion and gravity, every robot with all others as instruments."""
    centre = centre_of(poses)
    from_centre = [centre.inverse() @ pose for pose in poses]
    fit = fit_parameters(body_motions(signals, from_centre), total_wrench(_wrench(signals), from_centre), signals.rate)
    numbers, covariance = at_first_grasp(fit.solution, fit.covariance, centre)
    return ParametersFit(numbers, covariance, fit.residual)


def centre_of(poses: Sequence[Pose]) -> Pose:
    """Middle of the grasps, in the first one's axes: seen from there, no robot's noise has a long lever."""
    return Pose(np.eye(3), np.mean([pose.translation for pose in poses], axis=0))


def at_first_grasp(parameters: Array, covariance: Array, centre: Pose) -> tuple[Array, Array]:
    """``(m, h, J)`` (10,) in the first robot's frame, with covariance, of ``theta`` (10,) about the centre."""
    inertia = Inertia.from_barycentric(parameters)
    to_central = np.linalg.inv(barycentric_derivative(inertia))
    return central_numbers(inertia.carried(centre)), to_central @ covariance @ to_central.T


def grasps_from_twists(signals: Signals, with_instruments: bool) -> tuple[TeamPoses, list[Array]]:
    """Poses of all pairs from their twists, then of the team, and by how much the pairs' loops failed to close."""
    twists = np.concatenate([signals.w, signals.v], axis=-1)
    count = len(twists)
    pairs: dict[tuple[int, int], PoseEstimate] = {}
    for i in range(count):
        for j in range(i + 1, count):
            instrument = _instrument(signals.w, i, j) if with_instruments else None
            pairs[i, j] = pair_pose(twists[i], twists[j], signals.rate, instrument)
    return close_loops(count, pairs), loop_errors(pairs)


def _instrument(w: Array, i: int, j: int) -> Array:
    """What the robots that are not of this pair say of ``w_i``, on average; of two robots, what the other one says."""
    third = [k for k in range(len(w)) if k not in (i, j)] or [j]
    result: Array = np.mean([w[k] @ kabsch(w[i], w[k]).T for k in third], axis=0)
    return result


def _moving(recording: Recording, cutoff: float) -> Signals:
    check_recording(recording)
    return signals_of(recording, cutoff)


def _motion(signals: Signals) -> Array:
    """Motion ``(w, v, a, alpha)`` of the first robot's grasp frame, shape (n, 12)."""
    return np.hstack([signals.w[0], signals.v[0], signals.a[0], signals.alpha[0]])


def _wrench(signals: Signals) -> Array:
    if signals.wrench is None:
        raise RecordingError("'wrench' is missing of some robot: mass and inertia need the forces of all")
    return signals.wrench
