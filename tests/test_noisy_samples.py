"""Residuals that are larger than noise explains: some samples are wrong, or noise is larger than sensors claim."""

from __future__ import annotations

from msgspec.structs import replace

from agents.noise_judge import NoiseJudge
from tests.in_process import changed, steps

CLAIMED = 0.6
"""Share of their noise that sensors claim: squares are 2.8 times as large as that says, so a fit notices."""


SAMPLES = 300.0
"""Of so many samples squares are hardly ever larger than 1.23, by chance."""


def are_noisy(*squares: float) -> list[bool]:
    """What fits to ever new samples say."""
    judge = NoiseJudge()
    return [judge.must_leave_out(square, SAMPLES, are_rough=False) for square in squares]


def test_wrong_samples_are_left_out_each_time_that_they_come():
    assert are_noisy(0.9, 1.2, 5.0, 1.0, 0.9, 1.4, 1.1) == [False, False, True, False, False, True, False]


def test_the_more_samples_the_less_may_be_chance():
    assert not NoiseJudge().must_leave_out(1.2, SAMPLES, are_rough=False)
    assert NoiseJudge().must_leave_out(1.2, 1000.0, are_rough=False)


def test_rough_poses_leave_larger_residuals():
    assert not NoiseJudge().must_leave_out(1.7, SAMPLES, are_rough=True)
    assert NoiseJudge().must_leave_out(1.9, SAMPLES, are_rough=True)


def test_samples_that_become_worse_and_worse_are_left_out():
    assert are_noisy(1.6, 2.5, 4.0, 1.0, 1.6) == [True, True, True, False, True]


def test_noise_that_has_become_smaller_is_small():
    assert are_noisy(1.6, 1.6, 1.0, 1.6) == [True, False, False, True]


def test_what_is_not_better_without_the_samples_is_noise():
    assert are_noisy(1.6, 1.6, 1.7, 1.6, 3.0) == [True, False, False, False, True]


def test_a_team_weighs_its_load_if_sensors_are_noisier_than_they_claim():
    scenario = changed("ring3", load_changes=(), duration=12.0)
    claimed = replace(scenario, sensors=replace(scenario.sensors, noise_scale=CLAIMED * scenario.sensors.noise_scale))
    last: dict[str, str] = {}
    for _, outboxes in steps(scenario, anew={0: claimed}):
        last |= {name: each.estimate.status for name, each in outboxes.items() if each.estimate is not None}
    assert last == dict.fromkeys(last, "valid")
    assert len(last) == 3
