"""Chapters: what was learned before something has changed is as good as the rows themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from coheft.estimation.geometry.body_motion import perturbation_between
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.moments.chapter import Chapter, EvidenceAt, Prior
from coheft.estimation.moments.fit import fit_state
from coheft.estimation.moments.fit_settings import FitSettings, Guess
from coheft.estimation.moments.likelihood import Derivatives
from coheft.estimation.moments.moments import RowMoments
from coheft.estimation.moments.sensor_errors import SensorErrors
from coheft.estimation.moments.start import first_poses
from coheft.estimation.moments.unknowns import THETA, State
from tests.estimation.moments.fitting import IDEAL, Fitted, add_rows, buffer_of, erring, fit, fit_from, normalised_error
from tests.estimation.moments.moving_team import NOISE, PERIOD, Team, make_team, noisy_for

SETTINGS = {
    "ideal": IDEAL,
    "errors": replace(IDEAL, errors=SensorErrors({"acceleration_bias": 0.05, "force_gain": 0.01, "gyro_gain": 0.005})),
    "delays": replace(IDEAL, errors=SensorErrors({"clock": 0.0005, "wrench_delay": 0.0005})),
    "offsets": replace(IDEAL, force_offset=2.0, torque_offset=0.2, gyro_offset=0.005),
}
EVERY = pytest.mark.parametrize("kind", SETTINGS)


def apart(one: Fitted, other: Fitted, settings: FitSettings) -> float:
    """How far the second estimate is from the first one, in standard deviations of the first."""
    unknowns = one.estimate.body.unknowns
    free = settings.free(unknowns, 0, with_load=True)
    step = other.estimate.state.since(one.estimate.state, unknowns)[free]
    return float(np.abs(step / np.sqrt(one.estimate.covariance.diagonal()[free])).max())


def deviations(found: Fitted, settings: FitSettings) -> Array:
    free = settings.free(found.estimate.body.unknowns, 0, with_load=True)
    return np.sqrt(found.estimate.covariance.diagonal()[free])


def in_chapters(rows: Array, settings: FitSettings, indices: Sequence[int]) -> Fitted:
    """Each chapter begins at one of these rows, and keeps two rows of the one before."""
    ends = [index + 2 for index in indices]
    found = fit(rows[: ends[0]], settings)
    for first, end in pairwise([*ends, len(rows)]):
        found.chapter.end(found.estimate, found.chapter.buffer.count - 2)
        add_rows(found.chapter.buffer, rows[first:end], first)
        found = fit_from(found.estimate.state, found.chapter, settings)
    return found


# Means of twists are removed chapter by chapter, so short ones say a little less.
@EVERY
@pytest.mark.parametrize(("indices", "most", "share"), [([150], 0.15, 0.05), ([100, 150, 220], 0.8, 0.15)])
def test_several_chapters_say_what_one_says(kind: str, indices: Sequence[int], most: float, share: float) -> None:
    settings, rng = SETTINGS[kind], np.random.default_rng(1)
    _, rows = erring(make_team(seed=1, number=300), settings, rng)
    one, many = fit(rows, settings), in_chapters(rows, settings, indices)
    assert many.chapter.buffer.load_rows == len(rows) - indices[-1]
    assert apart(one, many, settings) < most
    np.testing.assert_allclose(deviations(many, settings), deviations(one, settings), rtol=share)
    # The last one alone says much less.
    assert (deviations(fit(rows[indices[-1] :], settings), settings) > 1.1 * deviations(one, settings)).mean() > 0.8


@EVERY
def test_many_chapters_are_as_honest_as_one(kind: str) -> None:
    settings, found = SETTINGS[kind], []
    for seed in range(8):
        state, rows = erring(make_team(seed, number=160), settings, np.random.default_rng(seed))
        result = in_chapters(rows, settings, [70, 100, 130])
        error = state.since(result.estimate.state, result.estimate.body.unknowns)
        found.append(normalised_error(error, result.estimate, settings))
    assert 0.6 < np.mean(found) < 1.5


@pytest.mark.parametrize("kind", ["ideal", "offsets"])
def test_a_new_load_is_found_and_poses_stay_known(kind: str) -> None:
    settings, light = SETTINGS[kind], make_team(seed=2, number=200)
    heavier = light.load * np.repeat([1.0, 1.3], [6, 10])
    _, rows = erring(light.holding(heavier, slice(120, None)), settings, np.random.default_rng(3))
    before = fit(rows[:120], settings)
    chapter, known = before.chapter, deviations(before, settings)[:12]
    add_rows(chapter.buffer, rows[120:], 120)
    chapter.end_of_load(before.estimate, 120, keeps_poses=True)
    assert not chapter.knows_load
    said = chapter.prior_evidence(before.estimate.body)
    theta = before.estimate.body.unknowns.theta
    assert not said.information[theta].any()
    assert not said.score[theta].any()
    after = fit_from(before.estimate.state.with_load(None), chapter, settings)
    load = after.estimate.state.load
    assert load is not None
    truth = light.holding(heavier).expressed_in(light.poses[0]).load
    covariance = after.estimate.covariance[theta, theta]
    assert np.abs((load - truth)[THETA] / np.sqrt(covariance.diagonal())).max() < 5.0
    assert (deviations(after, settings)[:12] <= 1.01 * known).all()
    # What the wrenches of the former load said of poses counts on.
    motion = Chapter(buffer_of(rows, settings, 3), settings)
    motion.buffer.begin_load(120)
    without = fit_from(before.estimate.state.with_load(None), motion, settings)
    assert (deviations(without, settings)[:12] > deviations(after, settings)[:12]).all()


def test_poses_that_are_not_known_take_nothing_over_from_wrenches() -> None:
    team = make_team(seed=4)
    found = fit(team.noisy(np.random.default_rng(5)))
    found.chapter.end_of_load(found.estimate, 60, keeps_poses=False)
    assert found.chapter.prior is None
    assert not found.chapter.knows_load
    assert found.chapter.buffer.load_rows == 40


def test_a_look_may_leave_out_the_newest_rows() -> None:
    team = make_team(seed=6)
    for settings in (IDEAL, SETTINGS["delays"]):
        rows = noisy_for(settings.errors, team, np.random.default_rng(7))
        chapter = Chapter(buffer_of(rows, settings, 3), settings)
        body = fit(rows, settings).estimate.body
        fewer = Chapter(buffer_of(rows[:60], settings, 3), settings)
        seen, expected = chapter.evaluation(end=60)(body), fewer.evaluation()(body)
        np.testing.assert_allclose(seen.motion.of_motion, expected.motion.of_motion, rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(seen.wrench.of_wrenches, expected.wrench.of_wrenches, rtol=1e-6, atol=1e-3)
        assert seen.wrench.number == pytest.approx(60.0)


def test_a_look_leaves_out_rows_of_the_load_but_not_former_ones() -> None:
    rows = make_team(seed=6).noisy(np.random.default_rng(7))
    found = fit(rows)
    found.chapter.buffer.begin_load(30)
    seen = found.chapter.evaluation(end=60)(found.estimate.body)
    assert (seen.motion.number, seen.wrench.number) == pytest.approx((60.0, 30.0))


@EVERY
def test_all_that_is_known_is_the_sum_of_rows_and_of_what_was_known(kind: str) -> None:
    settings = SETTINGS[kind]
    _, rows = erring(make_team(seed=8, number=200), settings, np.random.default_rng(9))
    found = in_chapters(rows, settings, [100])
    prior, body = found.chapter.posterior(found.estimate, found.chapter.evaluation()), found.estimate.body
    assert found.chapter.prior is not None
    expected = EvidenceAt(Derivatives(body)).of(found.chapter.evaluation()(body)) + found.chapter.prior.at(body)
    for name, value in vars(expected).items():
        np.testing.assert_allclose(getattr(prior.evidence, name), value, rtol=1e-9, atol=1e-9 * np.abs(value).max())
    empty = Chapter(buffer_of(rows[:0], settings, 3), settings, prior)
    free = settings.free(body.unknowns, 0, with_load=True)
    solution = empty.prior_evidence(body).restricted(free).solve(settings.limits(3, found.estimate.guess)[free])
    np.testing.assert_allclose(np.sqrt(solution.seen.diagonal()), deviations(found, settings), rtol=0.02)


def test_poses_that_tolerances_show_stay_seen_when_noisy_rows_become_a_prior() -> None:
    noise = replace(NOISE, kinematics=10.0 * NOISE.kinematics, wrench=10.0 * NOISE.wrench)
    errors = SensorErrors({"clock": 0.001, "wrench_delay": 0.001, "grasp_compliance": 2e-5})
    settings, team = FitSettings(noise, PERIOD, errors), make_team(seed=1, count=3, number=30)
    team = team.expressed_in(team.poses[0])
    found = fit(noisy_for(errors, team, np.random.default_rng(1), noise), settings)
    assert found.estimate.is_doubtful
    assert not found.estimate.misses_poses
    prior = found.chapter.posterior(found.estimate, found.chapter.evaluation())
    chapter = Chapter(buffer_of(np.zeros((0, 3 * errors.row_size + 1)), settings, 3), settings, prior)
    evaluate, before = chapter.evaluation(), chapter.prior_evidence
    again = fit_state(found.estimate.state, evaluate, before, found.estimate.guess, settings, 0, most_steps=1)
    assert not again.misses_poses


def test_a_prior_moves_with_the_state() -> None:
    found = fit(make_team(seed=10).noisy(np.random.default_rng(11)))
    prior, body = found.chapter.posterior(found.estimate, found.chapter.evaluation()), found.estimate.body
    step = 1e-3 * np.random.default_rng(12).normal(size=body.unknowns.size)
    moved = IDEAL.body(body.state.moved(step, body.unknowns, 6.0))
    expected = prior.evidence.shifted(step)
    np.testing.assert_allclose(
        prior.at(moved).score, expected.score, rtol=1e-6, atol=1e-6 * np.abs(expected.score).max()
    )
    np.testing.assert_array_equal(prior.at(body).score, prior.evidence.score)


def test_a_prior_that_is_loosened_knows_less() -> None:
    found = fit(make_team(seed=13).noisy(np.random.default_rng(14)))
    prior, unknowns = found.chapter.posterior(found.estimate, found.chapter.evaluation()), found.estimate.body.unknowns
    free, limits = IDEAL.free(unknowns, 0, True), IDEAL.limits(3, found.estimate.guess)
    spread = found.estimate.covariance[unknowns.theta, unknowns.theta]
    loosened = prior.with_process_noise(unknowns.theta, spread)
    before = (prior.evidence + IDEAL.expected(found.estimate.body)).restricted(free).solve(limits[free]).seen
    after = (loosened.evidence + IDEAL.expected(found.estimate.body)).restricted(free).solve(limits[free]).seen
    np.testing.assert_allclose(after[-10:, -10:], before[-10:, -10:] + spread, rtol=0.02, atol=1e-9)
    np.testing.assert_allclose(after[:12, :12], before[:12, :12], rtol=0.02, atol=1e-9)
    assert loosened.knows_load


def new_team(kind: str, members: list[int | None], seed: int) -> tuple[Fitted, State, FitSettings]:
    """A fit of few rows of a team of which some robots were in a former one, and its true state."""
    settings, rng = SETTINGS[kind], np.random.default_rng(seed)
    everyone = make_team(seed, count=4, number=200).expressed_in(make_team(seed, count=4).poses[0])
    former = fit(erring(carrying(everyone, [0, 1, 2]), settings, rng)[1], settings)
    prior = former.chapter.posterior(former.estimate, former.chapter.evaluation()).for_team(members, settings, settings)
    robots = [3 if then is None else then for then in members]
    team = carrying(everyone, robots)
    rows = erring(team, settings, rng)[1][:40]
    chapter = Chapter(buffer_of(rows, settings, len(members)), settings, prior)
    is_new = np.array([then is None for then in members])
    anchor = members.index(next(then for then in members if then is not None))
    state = first_poses(chapter.buffer.moments_kept(), prior.state, settings, is_new)
    return fit_from(state, chapter, settings, anchor), team.state(settings.errors), settings


def carrying(team: Team, robots: list[int]) -> Team:
    """Some of the robots carry the load alone; the first of them takes over what others did."""
    fewer = team.permuted(robots)
    total = np.sum([fewer.wrenches[:, i] @ p.adjoint().T for i, p in enumerate(fewer.poses)], axis=0)
    fewer.wrenches[:, 0] += (team.total_wrench - total) @ fewer.poses[0].inverse().adjoint().T
    return fewer


@pytest.mark.parametrize("members", [[0, 1], [0, 1, 2, None], [None, 2, 0], [1, None, 2]])
def test_robots_leave_and_join(members: list[int | None]) -> None:
    found, truth, settings = new_team("ideal", members, seed=15)
    unknowns, anchor = found.estimate.body.unknowns, next(i for i, then in enumerate(members) if then is not None)
    free = settings.free(unknowns, anchor, with_load=True)
    # In the frame of the robots that stayed, all is as well known as it was.
    to_frame = truth.poses[anchor].inverse()
    own = found.estimate.state.poses[anchor].inverse()
    covariance = found.estimate.covariance
    for robot in range(len(members)):
        error = perturbation_between(own @ found.estimate.state.poses[robot], to_frame @ truth.poses[robot])
        spread = np.sqrt(np.maximum(covariance.diagonal()[unknowns.poses[robot]], 0.0))
        assert np.abs(error[:3]).max() < 5.0 * spread[:3].max() + 0.01
        assert np.abs(error[3:]).max() < 5.0 * spread[3:].max() + 0.01
    assert not found.estimate.hidden_poses().any()
    load = found.estimate.state.load
    assert load is not None
    assert truth.load is not None
    assert load[6] == pytest.approx(truth.load[6], abs=5.0 * np.sqrt(covariance[unknowns.theta, unknowns.theta][0, 0]))
    assert len(free) == unknowns.size - 6 - 3 - 6


def test_changing_teams_are_as_honest_as_one() -> None:
    found = []
    for seed in range(12):
        result, truth, settings = new_team("ideal", [0, 2, None], seed)
        error = truth.since(result.estimate.state, result.estimate.body.unknowns)
        found.append(normalised_error(error, result.estimate, settings))
    assert 0.7 < np.mean(found) < 1.4


@EVERY
def test_who_has_left_is_eliminated(kind: str) -> None:
    settings = SETTINGS[kind]
    _, rows = erring(make_team(seed=16, count=4, number=150), settings, np.random.default_rng(17))
    found = fit(rows, settings)
    prior = found.chapter.posterior(found.estimate, found.chapter.evaluation())
    fewer = prior.for_team([0, 3, None, 1], settings, settings)
    unknowns, size = found.estimate.body.unknowns, fewer.evidence
    own = unknowns.own
    new = np.concatenate([np.arange(own), np.arange(own, 2 * own), np.arange(3 * own, 4 * own)])
    old = np.concatenate([unknowns.of_robot(robot) for robot in (0, 3, 1)])
    joined = np.arange(2 * own, 3 * own)
    assert not size.information[joined].any()
    assert not size.score[joined].any()
    for index, robot in ((0, 0), (1, 3), (3, 1)):
        assert fewer.state.poses[index] is found.estimate.state.poses[robot]
        np.testing.assert_array_equal(fewer.state.eta[index], found.estimate.state.eta[robot])
    assert not fewer.state.eta[2].any()
    np.testing.assert_array_equal(fewer.state.load, found.estimate.state.load)
    # Poses of those that stayed and the load are as well known as before.
    body, limits = found.estimate.body, settings.limits(4, found.estimate.guess)
    free = settings.free(unknowns, 0, with_load=True)
    before = np.zeros((unknowns.size, unknowns.size))
    before[np.ix_(free, free)] = (prior.evidence + settings.expected(body)).restricted(free).solve(limits[free]).seen
    held = np.setdiff1d(free, joined)
    after = np.zeros((unknowns.size, unknowns.size))
    expected = settings.expected(settings.body(fewer.state))
    after[np.ix_(held, held)] = (size + expected).restricted(held).solve(limits[held]).seen
    poses = [index for index in range(len(new)) if index % own < 6 and index >= own]
    ratio = np.sqrt(after.diagonal()[new[poses]] / before.diagonal()[old[poses]])
    if kind != "offsets":
        np.testing.assert_allclose(ratio, 1.0, atol=1e-3)
        return
    assert (ratio > 0.97).all()
    assert (ratio < 1.6).all()
    # One robot's offsets have left the sums, and another one's are in them.
    more = (after - before).diagonal()
    assert (more[unknowns.offset] > np.repeat([2.0, 0.2], 3) ** 2).all()
    assert (np.sqrt(more[unknowns.gyros]) > 1e-3).all()


def test_a_body_without_a_load_has_no_wrench_to_speak_of() -> None:
    team = make_team(seed=18)
    found = fit(team.noisy(np.random.default_rng(19)))
    body = IDEAL.body(found.estimate.state.with_load(None))
    with pytest.raises(ValueError, match="fit one first"):
        EvidenceAt(Derivatives(body)).of(found.chapter.evaluation()(body))


@EVERY
def test_noise_that_is_known_from_fewer_rows_is_that_of_all_rows(kind: str) -> None:
    settings = SETTINGS[kind]
    _, rows = erring(make_team(seed=22), settings, np.random.default_rng(23))
    found = fit(rows, settings)
    body, evaluation = found.estimate.body, found.chapter.evaluation
    at_body = EvidenceAt(Derivatives(body))
    for end in (20, None, 40):
        moments = evaluation(end=end)(body)
        for name, value in vars(EvidenceAt(Derivatives(body)).of(moments)).items():
            scale = np.abs(value).max()
            np.testing.assert_allclose(getattr(at_body.of(moments), name), value, rtol=1e-9, atol=1e-9 * scale)


def test_a_prior_says_what_it_was_told() -> None:
    team = make_team(seed=20)
    body = IDEAL.body(team.state())
    evidence = IDEAL.expected(body)
    guess = Guess.of(body, RowMoments.of(team.rows))
    with_expectations = Prior(body.state, guess, evidence, has_expectations=True)
    chapter = Chapter(buffer_of(team.rows, IDEAL, 3), IDEAL, with_expectations)
    np.testing.assert_array_equal(chapter.prior_evidence(body).information, evidence.information)
    chapter = Chapter(buffer_of(team.rows, IDEAL, 3), IDEAL, replace(with_expectations, has_expectations=False))
    np.testing.assert_array_equal(chapter.prior_evidence(body).information, 2.0 * evidence.information)
    chapter = Chapter(buffer_of(team.rows, IDEAL, 3), IDEAL)
    np.testing.assert_array_equal(chapter.prior_evidence(body).information, evidence.information)
    assert isinstance(team.poses[0], Pose)
    assert (IDEAL.noise, IDEAL.period) == (NOISE, PERIOD)


def test_who_has_joined_has_the_tolerances_of_its_sensors_also_after_a_chapter_has_ended() -> None:
    settings = SETTINGS["errors"]
    _, rows = erring(make_team(seed=16, count=4, number=150), settings, np.random.default_rng(17))
    found = fit(rows, settings)
    found.chapter.end(found.estimate, 148)
    assert found.chapter.prior is not None
    fewer = found.chapter.prior.for_team([0, 3, None, 1], settings, settings)
    own = found.estimate.body.unknowns.eta[2]
    expected = np.diag(settings.errors.deviations[0] ** -2.0)
    np.testing.assert_allclose(fewer.evidence.information[np.ix_(own, own)], expected)
