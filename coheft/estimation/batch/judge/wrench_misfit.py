"""Fits of a rigid body, with or without a fault, to the total wrench, and how much more than noise they leave.

The noise of forces, and that of poses through the body's dynamics, are measured above the band of the motion; residuals
are whitened with both. Uncertain grasp poses and calibration errors are fitted along: they must not refute a recording.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.calibrated_fit import force_columns
from coheft.estimation.batch.judge.band import Band
from coheft.estimation.batch.judge.evidence import Evidence, acceleration_noise, wrench_noise
from coheft.estimation.batch.pairs import derivative_by_poses
from coheft.estimation.batch.signals import body_motions, regressor, total_wrench
from coheft.estimation.batch.wrist_poses import Tolerances
from coheft.estimation.geometry.body_motion import BODY_A, BODY_V, BODY_W
from coheft.estimation.geometry.spatial import Array, Pose, skew
from coheft.estimation.rigid_body.regressor import spatial_inertia

_FINEST = 5e-5
"""Share of the wrench to which filters and differences are exact."""
REWEIGHTINGS = 3
_ROUNDING = 1e-11
_UNCERTAIN = 1e-9
"""Share of the largest variance of grasps below which a direction is certain."""
_SMALL = 0.1
"""Share of the residuals' mean square up to which noise in columns is corrected for in the likelihood."""
_LEVEL_UNSURE = 0.3
"""Relative uncertainty of the noise's power, which is measured in a band: two standard deviations."""
_NOTICED = 0.2
"""Norm, in deviations of the noise, below which an uncertain parameter does not matter."""
BODY_NUMBERS = 10
Maps = Sequence[Array]
"""Matrices (6, 6), one for each unknown of a fault, by which a sensor's reading is multiplied."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A fit of the total wrench.

    Attributes:
        misfit: -2 log likelihood.
        solution: ``theta`` (10,), then the fault's unknowns.
        covariance: Covariance of the solution.
        residual: Whitened residual, shape (K, 2, 3): forces, moments.
        excess: Its excess over noise, in deviations, see ``Band.excess``.
        inside: Its mean square in the band of the motion.
    """

    misfit: float
    solution: Array
    covariance: Array
    residual: Array
    excess: float
    inside: float

    @property
    def mass(self) -> tuple[float, float]:
        """Mass of the load and its standard deviation [kg]."""
        return float(self.solution[0]), float(np.sqrt(max(self.covariance[0, 0], 0.0)))


class WrenchMisfit:
    """Fits of the total wrench of one recording, whose grasp poses are known."""

    def __init__(self, evidence: Evidence, colour: Array | None = None) -> None:
        """``colour`` (K, 2) is the power of forces' and moments' noise in multiples of white noise; None if white."""
        self._colour = None if colour is None else np.repeat(np.sqrt(colour), 3, axis=1)
        signals, poses = evidence.signals, evidence.poses
        self.evidence, self.signals, self.wrenches, self.poses = evidence, signals, signals.wrench, poses
        self.adjoints = [pose.adjoint() for pose in poses]
        self.motion = motion = body_motions(signals, poses).mean(axis=0)
        self.rotations: Array | None = None
        if signals.rotation is not None:
            self.rotations = signals.rotation @ np.array([pose.rotation.T for pose in poses])[:, None]
        """Of the body frame in each robot's home frame, shape (N, n, 3, 3); None without poses."""
        self.band = Band(signals, evidence.cutoff, np.hstack([motion[:, BODY_W], motion[:, BODY_V]]))
        self.regressor, self.total = regressor(motion), total_wrench(self.wrenches, poses)
        per_coefficient = signals.rate / evidence.recording.rate
        robots = range(len(poses))
        self.noise = [wrench_noise(evidence, k) * per_coefficient for k in robots]
        """Of each robot's coefficients, (6, 6)."""
        up, frequency = motion[:, BODY_A].mean(axis=0), self.band.frequency
        views = [acceleration_noise(evidence, k, up, frequency) for k in robots]
        self._motion_noise: Array = np.sum(views, axis=0) * per_coefficient / len(poses) ** 2
        self._unsure = np.zeros((6 * len(frequency), 0))
        """Whitened columns of the uncertain parameters, per standard deviation."""
        self._unsure_maps = np.zeros((len(poses), 0, 6, 6))
        """Maps of the readings in these columns."""
        theta = np.zeros(10)
        for _ in range(2):
            self._whiten(theta)
            theta = self.fit().solution
        self._whiten(theta)
        columns, maps = unsure_parameters(evidence, motion, theta)
        white = self._white(columns)
        noticed = np.linalg.norm(white, axis=0) > _NOTICED
        self._unsure, self._unsure_maps = white[:, noticed], maps[:, noticed]
        self.plain = self.fit()

    def _whiten(self, theta: Array) -> None:
        """Set the whitening of residuals at each frequency, for a body ``theta`` (10,)."""
        self._theta = theta
        squares = np.mean(self.total**2, axis=0)
        force = float(squares[:3].mean())
        sizes = np.repeat([force, float(squares[3:].mean()) + 0.01 * force], 3)
        finest = _FINEST**2 * sizes * len(self.total) / len(self.band.frequency) + 1e-18
        sensors = sum(
            (to_body @ noise @ to_body.T for to_body, noise in zip(self.adjoints, self.noise, strict=True)),
            start=np.diag(finest),
        )
        covariance = sensors + self._by_motion(theta)
        self._whitening = self._white_whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        if self._colour is not None:
            self._whitening = self._whitening / self._colour[..., None]
        self._design, self._output = self._white(self.regressor), self._white(self.total)

    def _by_motion(self, theta: Array) -> Array:
        """Covariance of a body's wrench due to noise of its motion, shape (K, 6, 6)."""
        inertia = spatial_inertia(theta)[:, [3, 4, 5, 0, 1, 2]]  # times (alpha, a)
        return inertia @ self._motion_noise @ inertia.T

    def _white(self, signals: Array) -> Array:
        """Whitened coefficients (6 K, ...) of wrenches (n, 6) or of columns (n, 6, u)."""
        coefficients = self.band.coefficients(signals)
        if signals.ndim == 2:
            return (self._whitening @ coefficients[..., None]).ravel()
        return (self._whitening @ coefficients).reshape(-1, signals.shape[-1])

    def total_with(self, robots: Sequence[int], wrenches: Array) -> Array:
        """The total wrench (n, 6) with other readings (N, n, 6) of these robots."""
        mixed = self.wrenches.copy()
        mixed[robots] = wrenches[robots]
        return total_wrench(mixed, self.poses)

    def fit_readings(self, robots: Sequence[int], maps: Maps) -> Fit:
        """Fit a body, and how much of these robots' readings, mapped by each of ``maps``, does not belong to it."""
        return self.fit(self.reading_columns(robots, maps), [(robot, maps) for robot in robots])

    def reading_columns(self, robots: Sequence[int], maps: Maps) -> Array:
        """What these robots' readings, mapped by each of ``maps``, add to the total wrench, shape (n, 6, q)."""
        columns = [
            np.stack([self.wrenches[robot] @ (self.adjoints[robot] @ one).T for one in maps], axis=-1)
            for robot in robots
        ]
        result: Array = np.sum(columns, axis=0)
        return result

    def fit(
        self,
        columns: Array | None = None,
        maps: Sequence[tuple[int, Maps]] = (),
        total: Array | None = None,
        regressor: Array | None = None,
        passes: int = REWEIGHTINGS,
    ) -> Fit:
        """Fit a body together with a fault.

        Args:
            columns: Derivative of the total wrench by the fault's unknowns, shape (n, 6, q).
            maps: If the columns are readings and so contain their noise: the robots, and the maps of their readings.
            total: The total wrench without the fault, shape (n, 6), if it differs from the measured one.
            regressor: The body's regressor with the fault, shape (n, 6, 10), if it differs.
            passes: Number of estimates of the residuals' spectrum; one is enough to find a start.
        """
        design = self._design if regressor is None else self._white(regressor)
        if columns is not None:
            design = np.hstack([design, self._white(columns)])
        known = design.shape[1]
        design = np.hstack([design, self._unsure])
        output = self._output if total is None else self._white(total)
        spectrum = np.ones(len(output))
        best: Fit | None = None
        for _ in range(passes):
            fit = self._weighted(design, known, output, np.sqrt(spectrum), maps)
            if best is None or fit.misfit < best.misfit:
                best = fit
            spectrum = np.repeat(self.band.spread(fit.residual), 3, axis=1).ravel()
        assert best is not None
        return best

    def _weighted(
        self, design: Array, known: int, output: Array, deviation: Array, maps: Sequence[tuple[int, Maps]]
    ) -> Fit:
        """Least squares; the bias from the readings' noise in the columns is taken out of the normal equations.

        Otherwise whatever makes readings smaller, such as shorter lever arms, would leave less noise, and seem right.

        Unknowns from ``known`` on have a prior of mean zero and standard deviation one.
        """
        scaled, seen = design / deviation[:, None], output / deviation
        size = np.linalg.norm(scaled, axis=0)
        size = np.where(size > 0.0, size, 1.0)
        scaled = scaled / size
        by_noise, by_output = self._of_own_noise(deviation, maps, known, design.shape[1])
        information = scaled.T @ scaled - by_noise / np.outer(size, size)
        prior = (np.arange(len(size)) >= known) / size**2
        information[np.diag_indices_from(information)] += prior
        values, vectors = np.linalg.eigh(information)
        shown = values > _ROUNDING * values[-1]
        inverse = (vectors[:, shown] / values[shown]) @ vectors[:, shown].T
        normal = scaled.T @ seen - by_output / size
        solution = inverse @ normal
        solution += inverse @ (normal - information @ solution)
        solution = solution / size
        residual = (output - design @ solution).reshape(-1, 2, 3)
        misfit = self.band.misfit(residual) + float(np.sum(solution[known:] ** 2))
        own = float(solution @ (2.0 * by_output - by_noise @ solution))
        if maps:  # a lighter load also has less noise due to motion
            weighted = self._whitening / deviation.reshape(-1, 6, 1)
            taken = self._by_motion(self._theta) - self._by_motion(solution[:BODY_NUMBERS])
            own += float(np.sum((weighted @ taken) * weighted))
        if own > -_SMALL * residual.size:  # much larger noise is in the estimated spectrum already
            misfit += own + _LEVEL_UNSURE * abs(own)
        unknowns = round(int(np.count_nonzero(shown)) * self.band.moving / len(self.band.frequency))
        excess, inside = self.band.excess(residual, unknowns)
        covariance = (inverse / np.outer(size, size))[:known, :known]
        return Fit(misfit, solution[:known], covariance, residual, excess, inside)

    def _of_own_noise(
        self, deviation: Array, maps: Sequence[tuple[int, Maps]], known: int, unknowns: int
    ) -> tuple[Array, Array]:
        """Expected contribution of noise to columns times columns (u, u), and to columns times output (u,)."""
        by_noise, by_output = np.zeros((unknowns, unknowns)), np.zeros(unknowns)
        all_maps = np.zeros((len(self.poses), unknowns, 6, 6))
        all_maps[:, known:] = self._unsure_maps
        for robot, of_fault in maps:
            all_maps[robot, BODY_NUMBERS:known] = of_fault
        # Coloured noise, so whitened, has the power of white noise before.
        weighted = self._white_whitening / deviation.reshape(-1, 6, 1)
        information = np.einsum("kij,kil->jl", weighted, weighted)
        for to_body, noise, own in zip(self.adjoints, self.noise, all_maps, strict=True):
            at_sensor = to_body.T @ information @ to_body
            by_output += np.einsum("aij,ij->a", own, at_sensor @ noise)
            by_noise += np.einsum("aij,bij->ab", own, at_sensor @ own @ noise)
        return by_noise, by_output

    def share(self) -> float:
        """The residual beyond noise in the band of the motion, as a share of the wrench's changes there."""
        changing = self._white(self.total - self.total.mean(axis=0)).reshape(-1, 6)[: self.band.moving]
        left = self.plain.residual[: self.band.moving]
        return float(np.sqrt(max(0.0, np.sum(left**2) - left.size) / max(float(np.sum(changing**2)), 1e-300)))


def unsure_parameters(evidence: Evidence, motion: Array, theta: Array) -> tuple[Array, Array]:
    """Effects of uncertain grasp poses and, if they were estimated, calibration errors, by one standard deviation each.

    Returns:
        Change of the total wrench's residual by q parameters, shape (n, 6, q), and the matrices by which each robot's
        readings, with their noise, enter it, shape (N, q, 6, 6).
    """
    columns, maps = _by_grasps(evidence, theta)
    if evidence.tolerances is None:
        return columns, maps
    more, their_maps = _by_calibration(evidence, evidence.tolerances, motion, theta)
    return np.concatenate([columns, more], axis=-1), np.concatenate([maps, their_maps], axis=1)


def _by_grasps(evidence: Evidence, theta: Array) -> tuple[Array, Array]:
    signals = evidence.signals

    def left(poses: Sequence[Pose]) -> Array:
        motion = body_motions(signals, poses).mean(axis=0)
        return (total_wrench(signals.wrench, poses) - regressor(motion) @ theta).ravel()

    values, vectors = np.linalg.eigh(evidence.team.covariance)
    kept = values > _UNCERTAIN * values[-1]
    units = vectors[:, kept] * np.sqrt(values[kept])
    by_unit = derivative_by_poses(left, evidence.poses) @ units
    moves = np.einsum(
        "kji,kajq->kqai", [pose.rotation for pose in evidence.poses], units.reshape(-1, 2, 3, units.shape[1])
    )
    maps = np.zeros((*moves.shape[:2], 6, 6))
    maps[..., :3, :3] = maps[..., 3:, 3:] = skew(moves[:, :, 0])
    maps[..., 3:, :3] = skew(moves[:, :, 1])
    return by_unit.reshape(len(signals.time), 6, -1), maps


def _by_calibration(evidence: Evidence, tolerances: Tolerances, motion: Array, theta: Array) -> tuple[Array, Array]:
    """Scales and offsets of forces, the common scale of lengths, and the direction of gravity."""
    signals, poses = evidence.signals, evidence.poses
    assert signals.rotation is not None
    count = len(poses)
    sizes = np.repeat([tolerances.force_scale, tolerances.force_offset], [count, 3 * count])
    columns = [sizes * force_columns(signals.wrench, signals.rotation, poses)]
    to_home = signals.rotation[0] @ poses[0].rotation.T
    down = evidence.recording.gravity @ to_home
    for change, size in (
        (down, tolerances.position_scale),
        *((np.cross(axis, evidence.recording.gravity) @ to_home, evidence.tilt) for axis in np.eye(3)),
    ):
        moved = np.zeros_like(motion)
        moved[:, BODY_A] = size * change
        columns.append((regressor(moved) @ theta)[..., None])
    joined = np.concatenate(columns, axis=-1)
    maps = np.zeros((count, joined.shape[-1], 6, 6))
    maps[np.arange(count), np.arange(count)] = tolerances.force_scale * np.eye(6)
    return joined, maps
