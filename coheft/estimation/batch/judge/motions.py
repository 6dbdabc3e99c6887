"""Whether measured twists and accelerations of all robots are those of one load.

Each robot's motion predicts that of the body frame. Its difference from the mean of all others is noise, and the effect
of small errors of the grasp poses, which are fitted; a larger difference is the fault of a sensor.
"""

from collections.abc import Iterator

import numpy as np

from coheft.estimation.batch.inertia_fit import others
from coheft.estimation.batch.judge.band import Band
from coheft.estimation.batch.judge.evidence import Evidence, acceleration_noise, level_of
from coheft.estimation.batch.judge.verdict import Cause, Verdict
from coheft.estimation.batch.signals import body_motions
from coheft.estimation.geometry.body_motion import BODY_A, BODY_V, BODY_W, grasp_derivatives
from coheft.estimation.geometry.spatial import Array, Pose, skew

_EXCESS, _SHARE, _MENDED = 4.5, 0.03, 0.02
"""As in ``forces``: deviations that are no chance, share of the motion that matters, share that a fault may leave."""
_CALIBRATED = 0.1
"""Difference of a factor from minus one that calibration may explain."""
_OTHER_GRAVITY = 0.01
"""Relative difference from gravity that is more than that of places and of accelerometers."""
_OTHER_DOWN = 5.0
"""Largest angle between gravity in accelerations and in poses [degrees]."""
_CHANNELS = (
    ("angular velocities", "rad/s", slice(0, 3)),
    ("velocities", "m/s", slice(3, 6)),
    ("accelerations", "m/s²", slice(6, 9)),
)


def judge_motions(evidence: Evidence) -> Verdict | None:
    """Find a robot whose measured twists or accelerations do not fit the others'; None if there is none."""
    if not evidence.recording.has("twist"):
        return None
    views = [_View(evidence, robot) for robot in range(len(evidence.poses))]
    worst = max(range(len(views)), key=lambda robot: views[robot].excess)
    view, names = views[worst], evidence.recording.names
    if view.excess <= _EXCESS or view.share <= _SHARE:
        return None
    left, fault = min(view.faults())
    name = evidence.culprit(worst)
    whose = name or f"{names[worst]} (or the other way round, {names[1 - worst]})"
    is_mended = left < max(_EXCESS, _MENDED * view.excess)
    words = (
        f"what {whose} measures of its motion differs from what others measure by {view.ratio:.2g} times what noise "
        f"explains. {'One fault explains this' if is_mended else 'The likeliest fault'}: its {fault}"
    )
    if not is_mended:
        words += (
            ", which leaves much. Are twists (angular first) and accelerations all in the axes of the grasp frame, not "
            "of the home frame, of its origin, and simultaneous?"
        )
    return Verdict(Cause.MOTION, name, words=words, ratio=view.ratio)


def gravity_factors(evidence: Evidence) -> Array:
    """How large each robot's accelerations are at rest, in multiples of gravity, shape (N,)."""
    sizes: Array = np.linalg.norm(evidence.signals.up, axis=-1).mean(axis=1)
    return sizes / float(np.linalg.norm(evidence.recording.gravity))


def _angles_to_gravity(evidence: Evidence) -> Array:
    """Median angle between each robot's accelerations at rest and the vertical of its poses, shape (N,) [degrees]."""
    up, rotation = evidence.signals.up, evidence.signals.rotation
    if rotation is None:
        return np.zeros(len(up))
    vertical = -(evidence.recording.gravity @ rotation)
    along, aside = np.sum(up * vertical, axis=-1), np.linalg.norm(np.cross(up, vertical), axis=-1)
    angles: Array = np.degrees(np.median(np.arctan2(aside, along), axis=1))
    return angles


def judge_gravity(evidence: Evidence) -> Verdict | None:
    """Find accelerations that would be those of another gravity; None if there are none.

    All masses would be off by the same factor, and nothing else would show it.
    """
    if not evidence.recording.has("acceleration"):
        return None
    factors, names = gravity_factors(evidence), evidence.recording.names
    away = _angles_to_gravity(evidence)
    if away.max() > _OTHER_DOWN:
        name = names[int(np.argmax(away))]
        words = (
            f"accelerations of {name} are turned against its poses, by {away.max():.3g} degrees: give them in the axes "
            f"of the grasp frame; or its home frame is not level"
        )
        return Verdict(Cause.MOTION, name, (float(away.max()),), words)
    wrong = [name for name, factor in zip(names, factors, strict=True) if abs(factor - 1.0) > _OTHER_GRAVITY]
    if not wrong:
        return None
    factor = float(factors[np.argmax(np.abs(factors - 1.0))])
    size = float(np.linalg.norm(evidence.recording.gravity))
    words = (
        f"accelerations of {', '.join(wrong)} are {factor * size:.4g} m/s² without what twists say of the motion, "
        f"expected {size:.4g}, which is gravity: they are {factor:.4g} times what they should be, or their times or "
        f"those of the twists are wrong"
    )
    return Verdict(Cause.MOTION, wrong[0] if len(wrong) == 1 else None, (factor,), words)


class _View:
    """One robot's prediction of the body's motion against the others'.

    Attributes:
        excess: Excess of the difference over noise, with the grasp fitted, in deviations.
        ratio: Root mean square of the difference, in multiples of the noise's.
        share: The difference as a share of the motion's changes, of the channel in which it is largest.
    """

    def __init__(self, evidence: Evidence, robot: int) -> None:
        recording, signals = evidence.recording, evidence.signals
        motions = body_motions(signals, evidence.poses)
        kept = np.r_[BODY_W, BODY_V, BODY_A] if recording.has("acceleration") else np.r_[BODY_W, BODY_V]
        mean = others(motions)[robot]
        self._mean, self._difference = mean[:, kept], motions[robot][:, kept] - mean[:, kept]
        self._band = band = Band(signals, evidence.cutoff, mean[:, np.r_[BODY_W, BODY_V]])
        noise = [_noise(evidence, k, mean[:, BODY_A].mean(axis=0), band.frequency) for k in range(len(motions))]
        covariance = noise[robot] + (np.sum(noise, axis=0) - noise[robot]) / (len(noise) - 1) ** 2
        covariance = covariance[:, : len(kept), : len(kept)] * signals.rate / recording.rate
        sizes = np.mean(self._mean**2, axis=0)
        self._whitening = np.linalg.inv(np.linalg.cholesky(covariance + 1e-8 * np.diag(sizes + 1e-12)))
        self._grasp = grasp_derivatives(Pose.identity(), mean)[0][:, : len(kept)]
        _, residual = self._fit(self._grasp)
        self.excess, inside = band.excess(residual, 6)
        self.ratio = float(np.sqrt(inside))
        changing = self._white((self._mean - self._mean.mean(axis=0))[..., None]).reshape(residual.shape)
        size, left = (np.sum(one[: band.moving] ** 2, axis=(0, 2)) for one in (changing, residual))
        self.share = float(np.sqrt(np.max((left - 3.0 * band.moving) / np.maximum(size, 1e-300), initial=0.0)))

    def faults(self) -> Iterator[tuple[float, str]]:
        """The excess that is left with each fault fitted along, and the fault in words."""
        for what, unit, part in _CHANNELS[: self._difference.shape[1] // 3]:
            (x, y, z), left = self._with_fault(part, np.broadcast_to(np.eye(3), (len(self._mean), 3, 3)))
            yield left, f"{what} are off by ({x:.3g}, {y:.3g}, {z:.3g}) {unit}, in the load's axes"
            turn, left = self._with_fault(part, -skew(self._mean[:, part]))
            angle = np.degrees(np.linalg.norm(turn))
            yield left, f"{what} are in other axes than the rest, turned by about {angle:.2g} degrees"
            (excess,), left = self._with_fault(part, self._mean[:, part, None])
            factor = f"{what} are {1.0 + excess:.4g} times what they should be: another unit, or calibration"
            yield left, f"{what} have the opposite sign" if abs(2.0 + excess) < _CALIBRATED else factor

    def _with_fault(self, part: slice, columns: Array) -> tuple[Array, float]:
        """Unknowns (q,) of a fault of one channel with these columns (n, 3, q), and the excess that is left."""
        fault = np.zeros((*self._difference.shape, columns.shape[-1]))
        fault[:, part] = columns
        solution, residual = self._fit(np.concatenate([self._grasp, fault], axis=-1))
        return solution[6:], self._band.excess(residual, len(solution))[0]

    def _fit(self, columns: Array) -> tuple[Array, Array]:
        """Fit columns (n, c, q) to the difference: unknowns (q,), and whitened residual (K, c / 3, 3)."""
        design, seen = self._white(columns), self._white(self._difference[..., None]).ravel()
        flat = design.reshape(seen.size, -1)
        solution: Array = np.linalg.lstsq(flat, seen)[0].astype(np.float64)
        return solution, (seen - flat @ solution).reshape(len(design), -1, 3)

    def _white(self, columns: Array) -> Array:
        """Whitened coefficients of columns (n, c, q), shape (K, c, q)."""
        return self._whitening @ self._band.coefficients(columns)


def _noise(evidence: Evidence, robot: int, up: Array, frequency: Array) -> Array:
    """Covariance of the noise of ``(w, v, a)`` of the body frame as one robot predicts them, shape (K, 9, 9)."""
    to_body = evidence.poses[robot].adjoint()
    covariance = np.zeros((len(frequency), 9, 9))
    covariance[:, :6, :6] = to_body @ np.diag(level_of(evidence, robot, "twist") ** 2) @ to_body.T
    if evidence.recording.has("acceleration"):
        covariance[:, 6:, 6:] = acceleration_noise(evidence, robot, up, frequency)[:, 3:, 3:]
    return covariance
