"""Fits of a rigid body, with or without a fault, to the total wrench, and how much more than noise they leave.

The noise of forces, and that of poses through the body's dynamics, are measured above the band of the motion; residuals
are whitened with both.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from coheft.estimation.batch.body import body_motions, regressor, total_wrench
from coheft.estimation.batch.judge.band import Band
from coheft.estimation.batch.judge.evidence import Evidence
from coheft.estimation.batch.judge.motion_noise import acceleration_noise, wrench_noise
from coheft.estimation.batch.judge.unsure import unsure_parameters
from coheft.estimation.geometry.body_motion import BODY_A, BODY_V, BODY_W
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.regressor import spatial_inertia

_FINEST = 5e-5
"""Share of the wrench to which filters and differences are exact."""
REWEIGHTINGS = 3
_ROUNDING = 1e-11
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
