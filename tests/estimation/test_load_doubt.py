"""What is not claimed while samples of a load disagree, or a sensor may be off."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.load_change import LoadWindow
from coheft.estimation.spatial import Array
from tests.estimation.load_run import BLOCK, Run

FORCE, TORQUE = slice(0, 3), slice(3, 6)


def test_a_young_load_is_in_doubt_as_soon_as_its_samples_disagree() -> None:
    run = Run(seed=2, duration=4.0)
    grams = np.concatenate([run.grams(run.theta)[:6], run.grams(run.theta + run.dropped(0.3))[6:7]])
    for turn in range(2):
        window = LoadWindow(every=2, turn=turn)
        assert run.feed(window, grams) == []
        assert 2.0 < window.doubt < 40.0


def test_less_is_claimed_while_samples_disagree_though_no_change_is_certain() -> None:
    run = Run(seed=2, duration=12.0)
    old, new = run.grams(run.theta), run.grams(run.theta + run.dropped(0.3))
    window, doubts, found = LoadWindow(), [], []
    for block, gram in enumerate(np.concatenate([old[:100], new[100:]])):
        found += run.feed(window, gram[None], block)
        doubts.append(window.doubt)
    assert set(doubts[:100]) == {1.0}
    (change,) = found
    assert max(doubts[100 : change.last_block]) > 3.0
    assert doubts[change.last_block] == 1.0


def test_doubt_outlasts_samples_that_are_forgotten_without_a_change() -> None:
    run = Run(seed=2, duration=12.0)
    window = LoadWindow()
    run.feed(window, np.concatenate([run.grams(run.theta)[:60], run.grams(run.theta + run.dropped(0.03))[60:]]))
    doubt = window.doubt
    assert window.first_block == 0
    assert doubt > 2.0
    window.forget_before(20)
    assert window.doubt == doubt


@pytest.mark.parametrize("seed", range(3))
def test_covariances_cover_the_smaller_part_of_samples_that_disagree(seed: int) -> None:
    """As when a sensor is off, too little to be noticed, soon after the load was taken up."""
    run = Run(seed, duration=12.0)
    window, worst = LoadWindow(), 0.0
    for block, gram in enumerate(
        np.concatenate([run.grams(run.theta)[:60], run.grams(run.theta + run.dropped(0.03))[60:]])
    ):
        assert run.feed(window, gram[None], block) == []
        if window.doubt > 1.0:
            variances = window.doubt * np.linalg.inv(window.information(run.model).uncompensated).diagonal()
            worst = max(worst, float(np.max(np.abs(run.estimate(window) - run.theta) / np.sqrt(variances))))
    assert 0.0 < worst < 3.0


def after_a_while_of_another_load(run: Run, mass: float) -> Array:
    """Blocks of a load that was another one for 0.3 s, and 2 s since."""
    grams = run.grams(run.theta)[:146]
    grams[100:106] = run.grams(run.theta + run.dropped(mass))[100:106]
    return grams


@pytest.mark.parametrize("seed", range(10))
def test_a_while_of_another_load_makes_it_doubtful_when_no_border_shows_it_any_more(seed: int) -> None:
    """As when a sensor was off while too little was known to notice."""
    run = Run(seed, duration=10.0)
    window = LoadWindow(false_alarm=1e-200)  # nothing is forgotten
    assert run.feed(window, after_a_while_of_another_load(run, mass=0.15)) == []
    at_borders = window.statistics(run.model).max() / run.model.unknowns
    uneven = 4.0
    assert window.doubt > 2.0 * uneven * at_borders


@pytest.mark.parametrize("seed", range(10))
def test_what_was_before_a_while_of_another_load_is_forgotten_if_that_is_certain(seed: int) -> None:
    run = Run(seed, duration=10.0)
    window = LoadWindow()
    for block, gram in enumerate(after_a_while_of_another_load(run, mass=0.2)):
        window.push(block, gram)
    changes = [change for change in (window.review(run.model) for _ in range(16)) if change is not None]
    assert changes == [pytest.approx(106, abs=6)]
    assert window.first_block == changes[0]


def off(run: Run, size: float, first: int, last: int, sensor: slice = TORQUE) -> Array:
    """Excess of a sensor from one sample to another, a wrench (n, 6) each [N, N·m]."""
    excess = np.zeros((len(run.motion), 6))
    excess[first:last, sensor] = size * np.array([1.0, -0.7, 0.35])
    return excess


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("sensor", "size", "into_block"),
    [
        *[(TORQUE, 0.6, 0), (TORQUE, 2.0, 0), (TORQUE, 2.0, 2), (TORQUE, 2.0, 4), (TORQUE, 30.0, 1)],
        *[(FORCE, 2.0, 0), (FORCE, 5.0, 2), (FORCE, 30.0, 1)],
    ],
)
def test_a_sensor_that_is_off_is_not_taken_for_another_load(
    seed: int, sensor: slice, size: float, into_block: int
) -> None:
    """Neither while nobody can know, nor when it is right again."""
    run = Run(seed, duration=24.0)
    excess = off(run, size, 200 * BLOCK + into_block, 320 * BLOCK, sensor)
    window = LoadWindow()
    told = []
    for block, gram in enumerate(run.grams(run.theta, excess)):
        run.feed(window, gram[None], block)
        told.append(window.former is not None)
    assert not any(told[:200])
    assert np.mean(told[212:318]) > 0.8
    assert not any(told[350:])
    np.testing.assert_allclose(run.estimate(window)[0], run.theta[0], rtol=2e-2)


@pytest.mark.parametrize("lost", [1, 5])
def test_a_sensor_that_is_off_is_told_from_another_load_when_a_neighbour_has_noticed(lost: int) -> None:
    """Even if that is of blocks that this robot has not got; and others may find the change a little later."""
    run = Run(1, duration=24.0)
    grams = run.grams(run.theta, off(run, 2.0, 200 * BLOCK, len(run.motion)))
    window = LoadWindow()
    run.feed(window, grams[:200])
    window.accept(200, run.model)
    window.accept(201, run.model)
    run.feed(window, grams[200 + lost : 210], first=200 + lost)
    told = []
    for block, gram in enumerate(grams[210:], start=210):
        run.feed(window, gram[None], block)
        told.append(window.former is not None)
    assert np.mean(told) > 0.9


@pytest.mark.parametrize("mass", [3.0, 0.3, -1.0])
def test_another_load_is_never_taken_for_a_sensor_that_is_off_for_long(mass: float) -> None:
    for seed in range(3):
        run = Run(seed, duration=24.0)
        before, after = run.theta, run.theta + run.dropped(abs(mass))
        if mass < 0.0:
            before, after = after, before
        window, told = LoadWindow(), []
        for block, gram in enumerate(np.concatenate([run.grams(before)[:200], run.grams(after)[200:]])):
            run.feed(window, gram[None], block)
            told.append(window.former is not None)
        assert window.first_block >= 195
        assert sum(told) <= 15  # 0.75 s
        assert not told[-1]


@pytest.mark.parametrize("seed", range(3))
def test_what_a_load_was_is_held_against_the_first_samples_of_a_new_memory(seed: int) -> None:
    """As when a team begins anew: the same load is soon trusted, another one soon after, a sensor that is off never."""
    run = Run(seed, duration=10.0)
    before = LoadWindow()
    run.feed(before, run.grams(run.theta))
    load = before.known_load(run.model)
    assert load is not None
    np.testing.assert_allclose(load.parameters, run.estimate(before), rtol=1e-4)
    for grams, least, most in (
        (run.grams(run.theta), 5, 12),
        (run.grams(run.theta + run.dropped(1.0)), 0, 12),
        (run.grams(run.theta, off(run, 5.0, 0, len(run.motion), FORCE)), len(run.motion) // BLOCK, None),
    ):
        window, told = LoadWindow(), []
        window.expect(load)
        assert window.former is load
        assert window.known_load(run.model) is load
        for block, gram in enumerate(grams):
            run.feed(window, gram[None], block)
            told.append(window.former is not None)
        assert least <= sum(told)
        assert most is None or sum(told) <= most
