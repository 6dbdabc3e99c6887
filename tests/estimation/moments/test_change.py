"""Whether the load has changed: a ratio of likelihoods, and no alarm without a change."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from coheft.estimation.chi_square import chi_square_threshold
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.moments.body import FORCING, REGRESSOR, BodyModel, residual_covariance
from coheft.estimation.moments.change import FALSE_ALARM, InformationMaps, StepThresholds, look_for_change
from coheft.estimation.moments.change_at_fit import surprise
from coheft.estimation.moments.chapter import Chapter
from coheft.estimation.moments.derivatives import MotionDerivatives, WrenchDerivatives
from coheft.estimation.moments.evidence import Evidence
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.likelihood import wrench_evidence
from coheft.estimation.moments.moments import RowMoments, wrench_moments
from coheft.estimation.moments.rows import RowNoise
from coheft.estimation.moments.unknowns import THETA
from tests.estimation.moments.fitting import IDEAL, Fitted, fit
from tests.estimation.moments.moving_team import NOISE, Team, make_team

QUIET = RowNoise(1e-3 * NOISE.kinematics, NOISE.wrench)
"""So little noise of the motion that nothing has to be taken out."""
NOTHING_OLDER = np.zeros((19, 19))
THRESHOLD = chi_square_threshold(10, FALSE_ALARM)
OFFSETS = replace(IDEAL, noise=QUIET, force_offset=2.0, torque_offset=0.2)


@dataclass(frozen=True, eq=False)
class Watched:
    """Rows as a robot that knows the poses looks at them."""

    body: BodyModel
    views: Array
    maps: InformationMaps

    @staticmethod
    def of(team: Team, rows: Array, settings: FitSettings) -> Watched:
        body = settings.body(team.state())
        views = rows @ np.vstack([body.motion_map[FORCING], body.wrench_map]).T
        return Watched(body, views, InformationMaps.of(body, team.load, settings.expected(body)))

    def look(self, until: int | None = None, older: int = 0, is_known: bool = False) -> tuple[int, float]:
        views, older = self.views[older:until], self.views[:older]
        return look_for_change(views, older.T @ older, self.maps, is_known)[:2]

    def step(self, until: int, shortest: int = 8, mass: float | None = None) -> float | None:
        """By how much an estimate of the mass is off, of all rows unless it is given."""
        views = self.views[:until]
        if mass is None:
            matrices, vectors = self.maps.sums((views.T @ views)[None])
            mass = np.linalg.solve(matrices[0] + self.maps.known, vectors[0] + self.maps.known_vector)[THETA][0]
        small = StepThresholds(shortest, chi_square_threshold(1, 0.012), chi_square_threshold(1, 1e-6), mass)
        found = look_for_change(self.views[:until], NOTHING_OLDER, self.maps, small=small).step
        return None if found is None else found.error

    def gained(self, index: int, settings: FitSettings) -> float:
        """By how much the sum of squares of all rows is smaller if the load is another one from this place on."""
        root = np.linalg.cholesky(np.linalg.inv(residual_covariance(self.body, self.load))).T
        offset = np.linalg.cholesky(np.linalg.inv(settings.offset_covariance(self.body))).T
        by_load = np.einsum("nk,kij->nij", self.views[:, :13], REGRESSOR)
        newer = by_load[:, :, 6:].copy()
        newer[:index] = 0.0
        left = np.concatenate([(self.views[:, 13:] @ root.T).ravel(), np.zeros(6)])

        def square(design: Array) -> float:
            known = np.hstack([offset, np.zeros((6, design.shape[2] - 6))])
            flat = np.vstack([(root @ design).reshape(len(left) - 6, -1), known])
            scale = np.linalg.norm(flat, axis=0)
            return float(np.square(left - flat / scale @ np.linalg.lstsq(flat / scale, left)[0]).sum())

        return square(by_load) - square(np.concatenate([by_load, newer], axis=2))

    @property
    def load(self) -> Array:
        load = self.body.state.load
        assert load is not None
        return load


def heavier(team: Team, share: float) -> Array:
    return team.load * np.repeat([1.0, 1.0 + share], [6, 10])


@pytest.mark.parametrize("settings", [replace(IDEAL, noise=QUIET), OFFSETS], ids=["exact", "offsets"])
@pytest.mark.parametrize("share", [0.0, 0.02])
def test_the_statistic_is_what_least_squares_gain_from_two_loads(settings: FitSettings, share: float) -> None:
    team = make_team(seed=1, number=120)
    team = team.holding(heavier(team, share), slice(90, None))
    watched = Watched.of(team, team.noisy(np.random.default_rng(2), QUIET), settings)
    for until, older in ((60, 0), (100, 0), (120, 0), (120, 40)):
        index, statistic = watched.look(until, older)
        part = replace(watched, views=watched.views[:until])
        assert statistic * THRESHOLD == pytest.approx(part.gained(older + index, settings), rel=2e-3, abs=0.02)


def test_the_place_is_the_likeliest_one() -> None:
    team, settings = make_team(seed=3, number=120), replace(IDEAL, noise=QUIET)
    team = team.holding(heavier(team, 0.05), slice(97, None))
    watched = Watched.of(team, team.noisy(np.random.default_rng(4), QUIET), settings)
    gained = {index: watched.gained(index, settings) for index in range(60, 119)}
    index, statistic = watched.look()
    assert index == max(gained, key=lambda each: gained[each]) == 97
    assert statistic > 10.0


def test_no_alarm_without_a_change() -> None:
    for seed in range(3):
        team = make_team(seed, number=400)
        watched = Watched.of(team, team.noisy(np.random.default_rng(seed)), IDEAL)
        largest = max(watched.look(until)[1] for until in range(10, 401, 6))
        assert largest < 0.9


def test_the_statistic_is_chi_square_without_a_change() -> None:
    team, found = make_team(seed=5, number=31), []
    for seed in range(400):
        watched = Watched.of(team, team.noisy(np.random.default_rng(seed)), IDEAL)
        found.append(watched.look(is_known=False)[1] * THRESHOLD)
    # The largest of eight windows that overlap, of which short ones see fewer than ten directions.
    assert 10.0 < np.mean(found) < 22.0
    assert max(found) < chi_square_threshold(10, 1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_five_percent_of_the_mass_are_noticed_at_the_right_row(seed: int) -> None:
    team = make_team(seed, number=160)
    team = team.holding(heavier(team, 0.05), slice(150, None))
    watched = Watched.of(team, team.noisy(np.random.default_rng(seed + 10)), IDEAL)
    assert watched.look(150)[1] < 1.0
    alarms = [until for until in range(150, 161) if watched.look(until)[1] > 1.0]
    assert alarms[0] <= 154
    assert abs(watched.look(alarms[-1])[0] - 150) <= 1


def test_rows_that_are_not_kept_count() -> None:
    team = make_team(seed=6, number=200)
    team = team.holding(heavier(team, 0.02), slice(190, None))
    watched = Watched.of(team, team.noisy(np.random.default_rng(7)), IDEAL)
    (whole, statistic), (part, also) = watched.look(), watched.look(older=100)
    assert whole == part + 100
    assert also == pytest.approx(statistic, rel=1e-6)
    assert replace(watched, views=watched.views[100:]).look()[1] < statistic


@pytest.mark.parametrize("number", [1, 2, 10])
@pytest.mark.parametrize("is_known", [False, True])
def test_a_load_that_was_known_may_have_changed_before_the_very_first_row(is_known: bool, number: int) -> None:
    team = make_team(seed=8, number=130)
    former = fit(team.noisy(np.random.default_rng(9))[:100])
    later = team.holding(heavier(team, 0.1)).expressed_in(team.poses[0])
    body, prior = former.estimate.body, former.chapter.posterior(former.estimate, former.chapter.evaluation())
    rows = later.noisy(np.random.default_rng(10))[100 : 100 + number]
    views = rows @ np.vstack([body.motion_map[FORCING], body.wrench_map]).T
    known = Chapter(former.chapter.buffer, IDEAL, prior).prior_evidence(body)
    assert body.state.load is not None
    index, statistic, _ = look_for_change(
        views, NOTHING_OLDER, InformationMaps.of(body, body.state.load, known), is_known
    )
    assert (statistic > 1.0 and index == 0) == is_known


def test_nothing_to_look_at() -> None:
    team = make_team(seed=11)
    watched = Watched.of(team, team.rows, IDEAL)
    for until in (0, 1):
        assert watched.look(until) == (0, 0.0)
    assert watched.look(0, is_known=True) == (0, 0.0)


def newest_evidence(found: Fitted, rows: Array) -> Evidence:
    body = found.estimate.body
    assert body.state.load is not None
    moments = wrench_moments(body, RowMoments.of(rows))
    return wrench_evidence(body, WrenchDerivatives.at(body, MotionDerivatives.at(body)), moments)


def surprises(share: float, seeds: int) -> list[float]:
    """Statistics of 20 rows against a fit to 80 older ones."""
    found = []
    for seed in range(seeds):
        team = make_team(seed)
        team = team.holding(heavier(team, share), slice(80, None))
        rows = team.noisy(np.random.default_rng(seed + 50))
        older = fit(rows[:80])
        theta = older.estimate.body.unknowns.theta
        found.append(surprise(newest_evidence(older, rows[80:]), older.estimate.covariance, theta) * THRESHOLD)
    return found


def test_a_second_look_is_not_surprised_without_a_change() -> None:
    found = surprises(0.0, seeds=30)
    assert 7.5 < np.mean(found) < 12.5
    assert max(found) < chi_square_threshold(10, 1e-4)


def test_a_second_look_is_surprised_by_another_load() -> None:
    assert min(surprises(0.05, seeds=5)) > THRESHOLD


def test_where_nothing_is_seen_nothing_is_a_surprise() -> None:
    nothing = Evidence(np.ones(16), np.zeros((16, 16)), np.eye(16), np.eye(16))
    assert surprise(nothing, np.eye(16), slice(6, 16)) == 0.0


def test_a_second_look_allows_for_what_the_fit_does_not_know() -> None:
    team = make_team(seed=12)
    rows = team.holding(heavier(team, 0.05), slice(80, None)).noisy(np.random.default_rng(13))
    older = fit(rows[:80])
    theta, newest = older.estimate.body.unknowns.theta, newest_evidence(older, rows[80:])
    sizes = [surprise(newest, factor * older.estimate.covariance, theta) for factor in (0.0, 1.0, 100.0, 1e4)]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] > 1.1 * sizes[2]


def test_without_a_change_few_looks_find_a_step_that_is_too_small_to_be_noticed() -> None:
    team, found = make_team(seed=5, number=100), []
    for seed in range(200):
        watched = Watched.of(team, team.noisy(np.random.default_rng(seed)), IDEAL)
        found.append((watched.step(100) or 0.0) > 0.0)
        assert watched.step(100, shortest=100) is None
    assert 0.01 < np.mean(found) < 0.08


def test_a_recent_step_is_found_if_chance_alone_does_not_make_it() -> None:
    team = make_team(seed=6, number=120)
    changed = team.holding(heavier(team, 0.01), slice(108, None))
    watched = Watched.of(changed, changed.noisy(np.random.default_rng(1)), IDEAL)
    assert watched.step(112, mass=team.load[6]) == pytest.approx(0.01 * team.load[6], rel=0.35)


def test_a_step_that_is_too_small_to_be_noticed_is_found_as_large_as_it_is() -> None:
    team, found = make_team(seed=6, number=120), []
    mass = 0.002 * team.load[6]
    changed = team.holding(heavier(team, 0.002), slice(90, None))
    for seed in range(20):
        watched = Watched.of(changed, changed.noisy(np.random.default_rng(seed)), IDEAL)
        found.append((watched.look(112)[1], watched.step(112), watched.step(112, mass=team.load[6])))
    sizes, steps, from_older = np.transpose(found)
    assert np.median(sizes) < 1.0
    assert np.median(steps) == pytest.approx(0.8 * mass, rel=0.35), "the mean of all rows is off by less than the step"
    assert np.median(from_older) == pytest.approx(mass, rel=0.35)
