"""Test for a change of the load: the newest rows against all rows of the load, by a likelihood ratio.

With ``H`` and ``e`` the information and its vector of all rows of the load, and ``H_k`` and ``e_k`` those of the newest
``k`` of them, the score and its covariance without a change are

    S_k = e_k - H_k H^-1 e,    V_k = H_k - H_k H^-1 H_k,    S_k^T V_k^-1 S_k ~ chi-square with 10 degrees of freedom

which is the sum of squared residuals of all rows, less those of older and of newer ones fitted separately. The wrench
offset stays when the load changes: it is among the unknowns of ``H``, but only the part of ``S_k`` that concerns theta
is tested. This is the first test, at fixed poses (``look_for_change``); ``change_at_fit`` has the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.linear_algebra import inverse as inverse_of
from coheft.estimation.moments.body import FORCING, FORCING_SIZE, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.evidence import Evidence, seen_directions
from coheft.estimation.moments.fit import Estimate
from coheft.estimation.moments.likelihood import information_table
from coheft.estimation.moments.row_buffer import VIEW_SIZE
from coheft.estimation.moments.unknowns import LOAD_SIZE, THETA, Indices
from coheft.estimation.rigid_body.mass_properties import point_mass

FALSE_ALARM = 1e-12
"""Probability that one window of rows looks like another load without a change; a test covers up to 18."""
_RATIO = 1.5
_WINDOWS = np.unique(np.round(_RATIO ** np.arange(30)).astype(np.int64))
"""Numbers of newest rows that are tested, each 1.5 times the one before."""
_SPHERE: Array = np.array([each for each in product((-1.0, 0.0, 1.0), repeat=3) if any(each)])
_SPHERE /= np.linalg.norm(_SPHERE, axis=1)[:, None]
"""Points all over the unit sphere."""


@dataclass(frozen=True, eq=False)
class InformationMaps:
    """Maps from views of rows to information on the load at fixed poses.

    Attributes:
        of_gram: Takes Gram matrices (169,) of ``motion[FORCING]`` to information (256,).
        of_cross: Takes its moments with the wrench (78,) to the information vector (16,).
        of_noise: Contribution of the noise of one row's motion to the information, shape (16, 16).
        known: Prior information (16, 16) on the load.
        known_vector: Its information vector (16,).
    """

    of_gram: Array
    of_cross: Array
    of_noise: Array
    known: Array
    known_vector: Array

    @staticmethod
    def of(body: BodyModel, load: Array, known: Evidence | None = None) -> InformationMaps:
        """Compute them at a state, for a load (16,); ``known`` is prior evidence on all unknowns."""
        weight: Array = inverse_of(residual_covariance(body, load))
        of_gram = information_table(weight)
        of_cross = (weight @ REGRESSOR).reshape(-1, LOAD_SIZE)
        noise = body.motion_noise[FORCING[:, None], FORCING]
        of_noise = (noise.ravel() @ of_gram).reshape(LOAD_SIZE, LOAD_SIZE)
        if known is None:
            return InformationMaps(of_gram, of_cross, of_noise, np.zeros_like(of_noise), np.zeros(LOAD_SIZE))
        about = known.restricted(np.arange(body.unknowns.size)[body.unknowns.load])
        return InformationMaps(of_gram, of_cross, of_noise, about.information, about.score + about.information @ load)

    def sums(self, grams: Array) -> tuple[Array, Array]:
        """Return information, noise included, (k, 16, 16) and vectors (k, 16) of Gram matrices of views (k, 19, 19)."""
        of_motion, crossed = grams[:, :FORCING_SIZE, :FORCING_SIZE], grams[:, :FORCING_SIZE, FORCING_SIZE:]
        matrices = of_motion.reshape(len(grams), -1) @ self.of_gram
        vectors: Array = crossed.reshape(len(grams), -1) @ self.of_cross
        return matrices.reshape(-1, LOAD_SIZE, LOAD_SIZE), vectors


class StepThresholds(NamedTuple):
    """From which significance on small steps of the mass count, and the mass to which their errors refer.

    Attributes:
        shortest: Rows after which a step counts as long ago.
        long_ago: Least square of the significance of a step that long ago.
        recent: The same of a step since.
        mass: The estimate of the mass, from all rows or only from older ones [kg].
    """

    shortest: int
    long_ago: float
    recent: float
    mass: float


class SmallStep(NamedTuple):
    """A small step of the mass: the index of the first row after it, and the error of the estimated mass that it means
    [kg].
    """

    first: int
    error: float


class Look(NamedTuple):
    """The result of the first test.

    Attributes:
        first: Index of the first row after the likeliest change.
        statistic: Its statistic over the threshold for the probability ``FALSE_ALARM``.
        step: Of all significant small steps the one that means the largest error, 0 if there is none; None if there are
            too few rows.
    """

    first: int
    statistic: float
    step: SmallStep | None


def look_for_change(
    views: Array, older: Array, maps: InformationMaps, is_known: bool = False, small: StepThresholds | None = None
) -> Look:
    """Run the first test, at fixed poses, on views ``(motion[FORCING], wrench)`` of rows of the load (n, 19), oldest
    first.

    Of older rows there is the Gram matrix (19, 19). If the load ``is_known`` from before, all of these rows may belong
    to another one. Small steps of the mass are looked for if thresholds for these are given.
    """
    count = len(views)
    sizes = windows(count)
    if is_known and count:
        sizes = np.append(sizes, count)
    if len(sizes) == 0:
        return Look(0, 0.0, None)
    scores = _Scores.of(count - sizes, views, older, maps)
    index, statistic = scores.likeliest()
    if statistic > 1.0:  # now exactly which row
        newest = count - index
        near = np.arange(max(1, int(newest / _RATIO)), min(count + is_known, int(newest * _RATIO) + 2))
        scores = _Scores.of(count - near, views, older, maps)
        index, statistic = scores.likeliest()
    return Look(index, statistic, None if small is None else scores.small_step(small))


def windows(count: int) -> Indices:
    """Numbers of newest rows to test in the search for a change among so many rows, smallest first."""
    return _WINDOWS[: np.searchsorted(_WINDOWS, count)]


class _Scores(NamedTuple):
    """Of windows of newest rows, k of them, and of all rows.

    Attributes:
        firsts: Index of the first row of each window, shape (k,).
        counts: Rows of each window, then all, shape (k + 1,).
        matrices: Information with noise, shape (k + 1, 16, 16).
        vectors: Of the information, shape (k + 1, 16).
        of_noise: Noise in the information of one row, shape (16, 16).
        basis: Directions that all rows show, as rows, shape (b, 16).
        load: Of all rows, shape (16,).
    """

    firsts: Indices
    counts: Array
    matrices: Array
    vectors: Array
    of_noise: Array
    basis: Array
    load: Array

    @staticmethod
    def of(firsts: Indices, views: Array, older: Array, maps: InformationMaps) -> _Scores:
        """Of the windows that begin with these rows (k,), newest first."""
        grams, end = np.empty((len(firsts) + 1, VIEW_SIZE, VIEW_SIZE)), len(views)
        for k, index in enumerate([*firsts.tolist(), 0]):
            stretch = views[index:end]
            np.matmul(stretch.T, stretch, out=grams[k])
            end = index
        grams[-1] += older
        np.cumsum(grams, axis=0, out=grams)
        counts = grams[:, 0, 0]  # the first number of a view is 1
        matrices, vectors = maps.sums(grams)
        matrices[-1] += maps.known
        vectors[-1] += maps.known_vector
        basis, shares = seen_directions(matrices[-1], counts[-1] * maps.of_noise)
        load = basis.T @ np.linalg.solve(shares, basis @ vectors[-1])
        return _Scores(firsts, counts, matrices, vectors, maps.of_noise, basis, load)

    def along(self, directions: Array) -> tuple[Array, Array]:
        """``S`` (k, f) and ``V`` (k, f, f) along directions of theta (f, 10)."""
        part = directions @ self.matrices[:-1, THETA]
        part_of_noise = self.counts[:-1, None, None] * (directions @ self.of_noise[THETA])
        score = self.vectors[:-1, THETA] @ directions.T - (part - part_of_noise) @ self.load
        spread = (part + part_of_noise)[..., THETA] @ directions.T
        part = part @ self.basis.T
        spread -= part @ part.swapaxes(1, 2)
        each = range(len(directions))
        spread[:, each, each] += 1e-9
        return score, spread

    def likeliest(self) -> tuple[int, float]:
        """First row of the window that is likeliest to follow a change, and its statistic over the threshold."""
        tested, _ = seen_directions(self.matrices[-1, THETA, THETA], self.counts[-1] * self.of_noise[THETA, THETA])
        if len(tested) == 0:
            return 0, 0.0
        score, spread = self.along(tested)
        statistics = (score * np.linalg.solve(spread, score[..., None])[..., 0]).sum(axis=1)
        best = int(statistics.argmax())
        return int(self.firsts[best]), float(statistics[best]) / chi_square_threshold(len(tested), FALSE_ALARM)

    def small_step(self, small: StepThresholds) -> SmallStep | None:
        """Return ``Look.step``.

        With ``x`` another kilogram at the centre of mass, the step at a row and its significance are

            step = x^T S_k / (x^T V_k x),    z^2 = (x^T S_k)^2 / (x^T V_k x) ~ chi-square with 1 degree of freedom

        The newest rows show the mass of all rows and the share ``1 - x^T H_k x / x^T H x`` of the step.
        """
        if not self.load[THETA.start] > 0.0:
            return None
        is_long_ago = self.counts[:-1] >= small.shortest
        kilogram = one_kilogram(self.load)
        score, spread = (each.ravel() for each in self.along(kilogram[None]))
        is_significant = score**2 >= np.where(is_long_ago, small.long_ago, small.recent) * spread
        if not is_long_ago.any() and not is_significant.any():
            return None
        informations = kilogram @ self.matrices[:, THETA, THETA] @ kilogram
        left = 1.0 - informations[:-1] / informations[-1]
        errors = is_significant * np.abs(self.load[THETA.start] + score / spread * left - small.mass)
        largest = int(errors.argmax())
        return SmallStep(int(self.firsts[largest]), float(errors[largest]))


def spread_mass(estimate: Estimate) -> Array:
    """Second moment (10, 10) of the change of theta by 1 kg anywhere in the estimated load."""
    theta = estimate.state.fitted_load[THETA]
    points = point_mass(theta[1:4] / theta[0] + estimate.guess.size * _SPHERE)
    return points.T @ points / len(points)


def one_kilogram(load: Array) -> Array:
    """Change of theta (10,) by 1 kg at the centre of mass of a load (16,); zeros if the load has no mass."""
    mass, *moment = load[THETA][:4]
    return point_mass(np.array(moment) / mass) if mass > 0.0 else np.zeros(10)
