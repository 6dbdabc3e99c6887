from __future__ import annotations

import numpy as np
import pytest

from coheft.app.study.detection import judge_detection
from coheft.app.study.statistics import normalised_square, ratio_of_roots, root_mean
from coheft.wire.messages.structs import LoadChangeNotice

NOTHING = np.full(3, np.nan)


def test_root_mean_leaves_out_what_is_not_known() -> None:
    assert root_mean([np.array([9.0, np.nan]), np.array([16.0, 0.0])]) == pytest.approx(np.sqrt(25.0 / 3.0))
    assert np.isnan(root_mean([NOTHING, NOTHING]))


def test_ratio_is_taken_over_what_is_known_of_both() -> None:
    ratio = ratio_of_roots([np.array([4.0, np.nan, 100.0])], [np.array([1.0, 1000.0, np.nan])])
    assert (ratio.value, ratio.low, ratio.high) == (2.0, 2.0, 2.0)
    assert np.isnan(ratio_of_roots([NOTHING], [np.ones(3)]).value)


def test_interval_of_the_ratio_covers_the_truth_as_often_as_it_says() -> None:
    rng = np.random.default_rng(1)
    covered = []
    for _ in range(300):
        # Six robots of a run share most of their errors: the interval has to come from the runs.
        errors = rng.normal(size=(30, 1)) + 0.1 * rng.normal(size=(30, 6))
        ratio = ratio_of_roots(list(errors**2), list(np.full((30, 6), 1.01)))
        covered.append(ratio.low <= 1.0 <= ratio.high)
    assert 0.86 <= np.mean(covered) <= 0.98


def test_normalised_square_of_honest_errors_lies_in_its_interval_95_times_of_100() -> None:
    from scipy.stats import kstest  # takes a second, which all workers would need

    rng = np.random.default_rng(2)
    root = np.array([[2.0, 0.0], [0.5, 1e-3]])
    within, values = [], []
    for _ in range(400):
        nees = normalised_square(list(rng.normal(size=(20, 2)) @ root.T), [root @ root.T] * 20)
        within.append(nees.low <= nees.value <= nees.high)
        values.append(40.0 * nees.value)
    assert 0.92 <= np.mean(within) <= 0.98
    assert kstest(values, "chi2", args=(40,)).pvalue > 1e-3
    assert np.isnan(normalised_square([NOTHING], [np.eye(3)]).value)


def notice(noticed_at: float, changed_at: float) -> LoadChangeNotice:
    return LoadChangeNotice(noticed_at=noticed_at, changed_at=changed_at)


def test_delay_counts_until_the_last_robot_has_noticed() -> None:
    runs = [
        {"r1": [notice(20.1, 20.0)], "r2": [notice(20.3, 20.0)]},
        {"r1": [notice(20.1, 20.0)], "r2": [notice(20.1, 20.0)]},
        {"r1": [notice(20.1, 20.0)], "r2": []},
    ]
    found = judge_detection(runs, change=20.0, duration=24.0)
    assert found.delay_s == pytest.approx(0.2)
    assert found.delay_max_s == pytest.approx(0.3)
    assert (found.missed, found.false_alarms) == (1, 0)
    assert found.hours == pytest.approx(0.02)


def test_false_alarms_are_counted_once_for_all_robots_that_agree() -> None:
    early, late = notice(5.0, 4.8), notice(22.0, 21.8)
    refined, right = notice(20.5, 19.9), notice(20.1, 20.0)
    runs = [{"r1": [early, right, refined, late], "r2": [early, right]}]
    assert judge_detection(runs, change=20.0, duration=36.0).false_alarms == 2
    unchanged = judge_detection(runs, change=None, duration=36.0)
    assert (unchanged.false_alarms, unchanged.missed, unchanged.delay_s) == (4, 0, None)
    assert unchanged.false_alarms_per_hour == pytest.approx(400.0)


def test_without_any_run_there_is_no_rate_of_false_alarms() -> None:
    found = judge_detection([], change=None, duration=36.0)
    assert (found.false_alarms, found.false_alarms_per_hour, found.hours) == (0, None, 0.0)
