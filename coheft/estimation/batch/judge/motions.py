"""Whether what robots measure of their motion, twists and accelerations, is the motion of one load.

Each robot says how the body frame moves. By how much that differs from the mean of all others is noise, and what a
grasp that was found a little wrong adds; more than that is a sensor's.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.body import body_motions
from coheft.estimation.batch.inertia_fit import others
from coheft.estimation.batch.judge.band import Band
from coheft.estimation.batch.judge.cause import Cause
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.motion_noise import acceleration_noise, level_of
from coheft.estimation.batch.judge.verdict import Verdict
from coheft.estimation.geometry.body_motion import BODY_A, BODY_ALPHA, BODY_V, BODY_W
from coheft.estimation.geometry.spatial import Array, skew

_EXCESS, _SHARE, _MENDED = 4.5, 0.03, 0.02
"""As of forces: from when on it is more than chance, from when on it matters, and what a cause may leave."""
_CHANNELS = (
    ("angular velocities", "rad/s", slice(0, 3)),
    ("velocities", "m/s", slice(3, 6)),
    ("accelerations", "m/s²", slice(6, 9)),
)


@dataclass(frozen=True, eq=False)
class _Explained:
    """One robot's difference, with a cause fitted along: how much is left [deviations], and the cause in words."""

    excess: float
    words: str


def judge_motions(evidence: Evidence) -> Verdict | None:
    """Judge twists, and accelerations if there are any, that were measured.

    Returns:
        None if nothing speaks against them, or there are none.

    Raises:
        ValueError: There are too few samples, or too few per second, to tell noise from motion.
    """
    if not evidence.recording.has("twist"):
        return None
    views = [_View.of(evidence, robot) for robot in range(len(evidence.poses))]
    worst = max(range(len(views)), key=lambda robot: views[robot].plain)
    view, names = views[worst], evidence.recording.names
    if view.plain <= _EXCESS or view.share <= _SHARE:
        return None
    best = min(view.explained(), key=lambda one: one.excess)
    name = names[worst] if len(names) > 2 else None
    whose = name or f"{names[worst]} (or the other way round, {names[1 - worst]})"
    is_mended = best.excess < max(_EXCESS, _MENDED * view.plain)
    words = f"what {whose} measures of its motion differs from what others measure by {view.ratio:.2g} times what "
    words += f"noise explains. {'One cause mends it' if is_mended else 'Most like it is'}: its {best.words}"
    return Verdict(is_refuted=True, cause=Cause.MOTION, robot=name, ratio=view.ratio, words=words)


@dataclass(frozen=True, eq=False)
class _View:
    """One robot's motion against the others', whitened.

    Attributes:
        band: Of the coefficients.
        whitening: Shape (K, c, c).
        difference: Shape (n, c).
        grasp: What its grasp adds if it is elsewhere, shape (n, c, 6).
        mean: What the others say, shape (n, c).
        plain: How much more than noise is left with the grasp fitted, in deviations.
        ratio: Of its root mean square to that of noise.
        share: Of its changes, of the channel of which it is most.
    """

    band: Band
    whitening: Array
    difference: Array
    grasp: Array
    mean: Array
    plain: float
    ratio: float
    share: float

    @classmethod
    def of(cls, evidence: Evidence, robot: int) -> _View:
        recording, signals = evidence.recording, evidence.signals
        motions = body_motions(signals, evidence.poses)
        kept = np.r_[BODY_W, BODY_V, BODY_A] if recording.has("acceleration") else np.r_[BODY_W, BODY_V]
        own, mean = motions[robot][:, kept], others(motions)[robot]
        band = Band.of(signals, evidence.cutoff, mean[:, np.r_[BODY_W, BODY_V]])
        noise = [_noise(evidence, k, mean[:, BODY_A].mean(axis=0), band.frequency) for k in range(len(motions))]
        covariance = noise[robot] + (np.sum(noise, axis=0) - noise[robot]) / (len(noise) - 1) ** 2
        covariance = covariance[:, : len(kept), : len(kept)] * signals.rate / recording.rate
        sizes = np.mean(mean[:, kept] ** 2, axis=0)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance + 1e-8 * np.diag(sizes + 1e-12)))
        grasp = _by_grasp(mean)[:, : len(kept)]
        view = cls(band, whitening, own - mean[:, kept], grasp, mean[:, kept], 0.0, 1.0, 0.0)
        residual = view.left(grasp)
        excess, inside, _ = band.excess(residual, 6)
        changing = view.white((view.mean - view.mean.mean(axis=0))[..., None])[..., 0].reshape(residual.shape)
        size, left = (np.sum(one[: band.moving] ** 2, axis=(0, 2)) for one in (changing, residual))
        share = float(np.sqrt(np.max((left - 3.0 * band.moving) / np.maximum(size, 1e-300), initial=0.0)))
        return cls(band, whitening, view.difference, grasp, view.mean, excess, float(np.sqrt(inside)), share)

    def white(self, columns: Array) -> Array:
        """Whitened coefficients of columns (n, c, q), shape (K, c, q)."""
        result: Array = self.whitening @ self.band.coefficients(columns)
        return result

    def left(self, columns: Array) -> Array:
        """What columns (n, c, q) leave of the difference, whitened, shape (K, c / 3, 3)."""
        return self._fit(columns)[1]

    def _fit(self, columns: Array) -> tuple[Array, Array]:
        design, seen = self.white(columns), self.white(self.difference[..., None])[..., 0]
        flat = design.reshape(seen.size, -1)
        solution: Array = np.linalg.lstsq(flat, seen.ravel())[0].astype(np.float64)
        return solution, (seen.ravel() - flat @ solution).reshape(len(seen), -1, 3)

    def explained(self) -> Iterator[_Explained]:
        """With each cause: a channel that is off, too large, or turned."""
        for what, unit, part in _CHANNELS[: self.difference.shape[1] // 3]:
            one = np.zeros((*self.difference.shape, 3))
            one[:, part] = np.eye(3)
            solution, residual = self._fit(np.concatenate([self.grasp, one], axis=-1))
            x, y, z = solution[6:]
            off = f"{what} are off by ({x:.3g}, {y:.3g}, {z:.3g}) {unit}, in the load's axes"
            yield _Explained(self.band.excess(residual, 9)[0], off)
            one[:, part] = np.stack([np.cross(axis, self.mean[:, part]) for axis in np.eye(3)], axis=-1)
            solution, residual = self._fit(np.concatenate([self.grasp, one], axis=-1))
            angle = np.degrees(np.linalg.norm(solution[6:]))
            turned = f"{what} are in other axes than the rest, turned by about {angle:.2g} degrees"
            yield _Explained(self.band.excess(residual, 9)[0], turned)
            scaled = np.zeros((*self.difference.shape, 1))
            scaled[:, part, 0] = self.mean[:, part]
            solution, residual = self._fit(np.concatenate([self.grasp, scaled], axis=-1))
            factor = f"{what} are {1.0 + solution[6]:.4g} times what they should be: another unit, or calibration"
            yield _Explained(self.band.excess(residual, 7)[0], factor)


def _noise(evidence: Evidence, robot: int, up: Array, frequency: Array) -> Array:
    """Covariance of ``(w, v, a)`` of the body frame as one robot has it, shape (K, 9, 9)."""
    recording, pose, cutoff = evidence.recording, evidence.poses[robot], evidence.cutoff
    to_body = np.kron(np.eye(2), pose.rotation)
    to_body[3:, :3] = skew(pose.translation) @ pose.rotation
    covariance = np.zeros((len(frequency), 9, 9))
    covariance[:, :6, :6] = to_body @ np.diag(level_of(recording, "twist", robot, cutoff) ** 2) @ to_body.T
    if recording.has("acceleration"):
        covariance[:, 6:, 6:] = acceleration_noise(recording, robot, pose, up, frequency, cutoff)[:, 3:, 3:]
    return covariance


def _by_grasp(motion: Array) -> Array:
    """What a small turn and shift of a grasp adds to ``(w, v, a)`` of the body frame, shape (n, 9, 6)."""
    columns = np.zeros((len(motion), 9, 6))
    w, alpha = motion[:, BODY_W], motion[:, BODY_ALPHA]
    for k, axis in enumerate(np.eye(3)):
        columns[:, :3, k], columns[:, 3:6, k] = np.cross(axis, w), np.cross(axis, motion[:, BODY_V])
        columns[:, 6:, k] = np.cross(axis, motion[:, BODY_A])
        columns[:, 3:6, 3 + k] = np.cross(w, axis)
        columns[:, 6:, 3 + k] = np.cross(alpha, axis) + np.cross(w, np.cross(w, axis))
    return columns
