"""What is remembered of the load where robots have not the same samples, or learn of better poses meanwhile."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.wire.config import AgentConfig
from tests.estimation.team import Team
from tests.memory.memories import BLOCK, COUNT, OWN, Memories, distance, moved, with_a_fit_under_way

AS_THEY_ARE_OFF = 4e-6
"""Variance of poses that are off by 2 mrad and 2 mm."""


def test_not_everybody_need_have_the_same_samples(config: AgentConfig, team: Team) -> None:
    """What a robot has missed neither spoils the correction, nor looks like a change of the load."""
    used = moved(team, 4e-3), team.poses, moved(team, 2e-3)
    memories, anew, stale = (Memories(config, team, poses) for poses in used)
    memories.push(0, 5)
    memories.fit(moved(team, 2e-3))
    memories.push(5, 38, robots=[OWN, 0, 3])
    memories.push(38, 55)
    memories.fit(team.poses)
    assert memories.push(55, 60, robots=[1, 0, 2, 3]) == 5 * [None]
    for each in (stale, anew):
        each.push(0, 60)
    assert distance(memories.estimate(), anew.estimate()) < 0.2 * distance(stale.estimate(), anew.estimate())


def test_what_is_lacked_makes_the_load_less_certain(config: AgentConfig, team: Team) -> None:
    deviations = []
    for robots in (range(COUNT), [OWN, 0, 3]):
        memories = Memories(config, team, moved(team, 4e-3))
        memories.push(0, 5)
        memories.map_to(moved(team, 2e-3))
        memories.correct(memories.told(), AS_THEY_ARE_OFF)
        memories.push(5, 30, robots=robots)
        memories.push(30, 55)
        memories.fit(team.poses)
        deviations.append(memories.deviations())
    assert np.all(deviations[1] > 1.1 * deviations[0])


def test_what_somebody_does_not_have_from_the_beginning_does_not_count(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-2))
    memories.begin_roughly()
    memories.push(20, 30)
    memories.push_early(15, 20)
    memories.push_early(5, 15, robots=[OWN, 0, 3])
    memories.push(30, 31)
    memories.fit(team.poses)
    memories.push_early(0, 5, robots=[OWN, 0, 3])  # nor does it come back
    memories.push(31, 50)
    fresh = Memories(config, team, team.poses)
    fresh.push(15, 50)
    assert [memory.count for memory in memories.each] == COUNT * [35 * BLOCK]
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-3, atol=1e-3)


def test_forces_that_nobody_has_felt_yet_are_no_small_forces(config: AgentConfig, team: Team) -> None:
    """New poses may come into use before any sample: what they do to wrenches is counted all the same."""
    deviations = []
    for first in (0, 2):
        memories = Memories(config, team, moved(team, 4e-3))
        memories.push(0, first)
        memories.map_to(moved(team, 2e-3))
        rows = memories.told()
        memories.push(first, 3)
        memories.correct(rows, AS_THEY_ARE_OFF)
        assert not any(memory.is_spoilt for memory in memories.each)
        memories.push(3, 20)
        deviations.append(memories.deviations())
    np.testing.assert_allclose(*deviations, rtol=0.5)


def test_that_somebody_has_just_begun_is_no_reason_to_forget_most(config: AgentConfig, team: Team) -> None:
    memories = with_a_fit_under_way(config, team)
    rows = memories.told()
    rows[1, 1] = 38.0
    memories.correct(rows)
    assert [memory.count for memory in memories.each] == COUNT * [40 * BLOCK]


def test_what_comes_early_while_a_correction_is_under_way_needs_none(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-2))
    memories.begin_roughly()
    memories.push(20, 22)
    memories.push_early(15, 20)
    memories.push(22, 24)
    memories.map_to(team.poses)
    rows = memories.told()
    memories.push_early(10, 15)
    memories.push(24, 25)
    memories.push_early(0, 10)
    memories.correct(rows)
    memories.push(25, 50)
    fresh = Memories(config, team, team.poses)
    fresh.push(0, 50)
    assert [memory.count for memory in memories.each] == COUNT * [50 * BLOCK]
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=3e-4, atol=3e-4)


def test_a_change_that_poses_hid_is_seen_when_they_are_known_well(config: AgentConfig, team: Team) -> None:
    """What disturbs corrected samples is what the new poses do, not what those did that they were summed with."""
    memories = Memories(config, team, moved(team, 4e-3))
    memories.push(0, 5)
    memories.map_to(moved(team, 2e-3))
    memories.correct(memories.told(), AS_THEY_ARE_OFF)
    assert memories.push(5, 25) == 20 * [None]
    assert memories.push(25, 40, load=1.006) == 15 * [None]
    memories.fit(team.poses)
    found = [changed_at for changed_at in memories.push(40, 46, load=1.006) if changed_at is not None]
    assert found == [pytest.approx(25, abs=2)]
