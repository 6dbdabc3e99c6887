"""What an arm can follow, and what not, however the limits are checked."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.reach import MAX_POSITION, MAX_ROTATION, Reach
from coheft.wire.scenario.schema import Robots

ROBOTS = load_scenario("ring6").robots
KINDS = [ROBOTS, replace(ROBOTS, stiffness=(ROBOTS.stiffness[0], 0.0)), replace(ROBOTS, damping=(0.0, 0.0))]
LARGEST = np.repeat([MAX_ROTATION, MAX_POSITION], 3)


@given(
    st.sampled_from(KINDS),
    st.lists(st.tuples(st.integers(0, 4), st.integers(0, 11), st.floats(width=32)), max_size=4),
    st.lists(st.tuples(st.integers(0, 5), st.floats()), max_size=2),
)
def test_a_reference_is_refused_exactly_if_it_asks_for_more_than_the_limits(
    robots: Robots, motions: list[tuple[int, int, float]], wrenches: list[tuple[int, float]]
) -> None:
    reach = Reach(robots)
    motion, wrench = np.zeros((5, 12)), np.zeros(6)
    for row, column, value in motions:
        motion[row, column] = value
    for axis, value in wrenches:
        wrench[axis] = value
    delay = np.repeat([reach.rotation_delay, reach.position_delay], 3)
    k_t, k_r = robots.stiffness
    pushes = np.repeat([k_t * MAX_POSITION, k_r * MAX_ROTATION], 3)
    with np.errstate(over="ignore", invalid="ignore"):
        asked = np.abs(motion[:, :6]) + delay * np.abs(motion[:, 6:])
    can_follow = bool((asked <= LARGEST).all() and (np.abs(wrench) <= pushes).all())
    found = reach.excess(Reference(robot="r1", block=4, answers=0, motion=motion, wrench=wrench))
    assert (found is None) == can_follow


@pytest.mark.parametrize("share", [0.99, 1.01])
@pytest.mark.parametrize("column", range(12))
def test_each_limit_counts(column: int, share: float) -> None:
    reach = Reach(ROBOTS)
    motion = np.zeros((5, 12))
    delay = np.repeat([reach.rotation_delay, reach.position_delay], 3)
    motion[3, column] = -share * (LARGEST[column] if column < 6 else LARGEST[column - 6] / delay[column - 6])
    found = reach.excess(Reference(robot="r1", block=4, answers=0, motion=motion, wrench=np.zeros(6)))
    assert (found is None) == (share < 1.0)
