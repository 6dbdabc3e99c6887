"""What is kept of a load that samples have agreed with, and when it is doubted again."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.estimation.load_change import LoadWindow
from coheft.estimation.load_comparison import KnownLoad
from coheft.estimation.spatial import Array
from tests.estimation.load_run import BLOCK, Run

UP = np.array([0.3, -0.2, 1.0, 0.0, 0.0, 0.0])


def known(run: Run, grams: Array) -> KnownLoad:
    window = LoadWindow()
    run.feed(window, grams)
    load = window.known_load(run.model)
    assert load is not None
    return load


def agreed(run: Run, grams: Array, load: KnownLoad) -> LoadWindow:
    """A memory whose samples have agreed with a load."""
    window = LoadWindow()
    window.expect(load)
    run.feed(window, grams)
    assert window.former is None
    return window


@pytest.mark.parametrize("forget", ["before", "since"])
def test_a_load_is_expected_again_when_all_samples_that_agreed_with_it_are_forgotten(forget: str) -> None:
    run = Run(seed=1, duration=10.0)
    load = known(run, run.grams(run.theta))
    window = agreed(run, run.grams(run.theta)[:40], load)
    if forget == "before":
        window.forget_before(40)
    else:
        window.forget_since(0)
    assert window.former is load


def test_what_few_samples_have_agreed_with_is_doubted_when_more_do_not() -> None:
    """A force sensor is off by a fraction of its noise: soon the load would be called heavier than it is."""
    run = Run(seed=1, duration=60.0)
    load = known(run, run.grams(run.theta))
    excess = np.broadcast_to(0.2 * UP, (len(run.motion), 6))
    window, told = LoadWindow(), []
    window.expect(load)
    for block, gram in enumerate(run.grams(run.theta, excess)):
        assert run.feed(window, gram[None], block) == []
        told.append(window.former is load)
        if not told[-1]:
            deviation = np.sqrt(np.linalg.inv(window.information(run.model).uncompensated)[0, 0])
            assert abs(run.estimate(window)[0] - run.theta[0]) < 5.0 * deviation
    assert not all(told[:200])  # 10 s
    assert all(told[-200:])


def test_a_load_that_was_hardly_seen_gives_way_to_what_motion_has_shown_since() -> None:
    at_rest, moving = Run(seed=1, duration=20.0, at_rest_until=20.0), Run(seed=1, duration=20.0)
    hardly = known(at_rest, at_rest.grams(at_rest.theta))
    window = agreed(moving, moving.grams(moving.theta), hardly)
    load = window.known_load(moving.model)
    assert load is not None
    assert load is not hardly
    np.testing.assert_allclose(load.parameters[0], moving.theta[0], rtol=1e-2)


def test_rest_does_not_make_up_for_what_motion_has_shown() -> None:
    """However long nothing new is seen: a sensor may still be off."""
    run, at_rest = Run(seed=1, duration=3.0), Run(seed=1, duration=60.0, at_rest_until=60.0)
    load = known(run, run.grams(run.theta))
    window, told = LoadWindow(), []
    window.expect(load)
    excess = np.broadcast_to(2.0 * UP, (len(at_rest.motion), 6))
    for block, gram in enumerate(at_rest.grams(at_rest.theta, excess)):
        run.feed(window, gram[None], block)
        told.append(window.former is not None)
    assert all(told)


def test_motion_does_not_make_up_for_what_a_constant_force_hides() -> None:
    """It shows the inertia, of which little was known; of the mass less than rest had shown, if a sensor may be off."""
    at_rest, run = Run(seed=1, duration=60.0, at_rest_until=59.0), Run(seed=1, duration=4.0)
    load = known(at_rest, at_rest.grams(at_rest.theta))
    window, told = LoadWindow(), []
    window.expect(load)
    for block, gram in enumerate(run.grams(run.theta, np.broadcast_to(2.0 * UP, (len(run.motion), 6)))):
        run.feed(window, gram[None], block)
        told.append(window.former is not None)
    assert all(told)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("blocks", [3, 6, 9])
def test_a_sensor_that_is_right_again_so_soon_that_few_samples_are_wrong_is_no_other_load(
    seed: int, blocks: int
) -> None:
    run = Run(seed, duration=24.0)
    excess = np.zeros((len(run.motion), 6))
    excess[100 * BLOCK : (100 + blocks) * BLOCK + 2] = 6.0 * UP
    window = LoadWindow()
    for block, gram in enumerate(run.grams(run.theta, excess)):
        run.feed(window, gram[None], block)
        if window.former is None and block >= 100 + blocks + 1:
            load = window.known_load(run.model)
            assert load is not None
            assert abs(load.parameters[0] - run.theta[0]) < 5.0 * np.sqrt(load.covariance[0, 0])
    assert window.former is None
