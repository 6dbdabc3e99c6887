"""What is remembered of the load follows better poses, as if all samples had been summed with them."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.wire.config import AgentConfig
from coheft.wire.estimator_settings import EfficientSettings
from tests.estimation.team import Team, make_team
from tests.memory.memories import BLOCK, COUNT, DURATION, OWN, Memories, distance, moved, with_a_fit_under_way


def errors_after_a_fit(config: AgentConfig, team: Team, size: float) -> tuple[float, float, float]:
    """How far the estimate is from that of samples summed anew: not mapped at all, mapped, and corrected as well."""
    blocks = round(DURATION * 100 / BLOCK)
    anew, stale, memories = (Memories(config, team, poses) for poses in (team.poses, *2 * [moved(team, size)]))
    for other in (anew, stale):
        other.push(0, blocks // 2)
        other.fit(other.poses)  # with weights from the same estimate
        other.push(blocks // 2, blocks)
    memories.push(0, blocks // 2)
    memories.map_to(team.poses)
    rows = memories.told()
    memories.push(blocks // 2, blocks)
    half = distance(memories.estimate(), anew.estimate())
    memories.correct(rows)
    return distance(stale.estimate(), anew.estimate()), half, distance(memories.estimate(), anew.estimate())


def test_a_fit_is_as_good_as_summing_anew_to_first_order(config: AgentConfig, team: Team) -> None:
    coarse, fine = (errors_after_a_fit(config, team, size) for size in (4e-3, 1e-3))
    for stale, mapped, corrected in (coarse, fine):
        assert corrected < 0.01 * mapped
        assert corrected < 0.002 * stale
    # A quarter of the step: a sixteenth of the error.
    assert fine[2] < coarse[2] / 14.0
    assert fine[0] == pytest.approx(coarse[0] / 4.0, rel=0.1)


def test_rows_of_another_load_are_not_used(config: AgentConfig, team: Team) -> None:
    """One robot has not heard of the last change yet: its moments are those of other samples."""
    for column, number in ((0, 13.0), (2, 0.0)):
        memories = with_a_fit_under_way(config, team)
        before = memories.estimate()
        rows = memories.told()
        rows[1, column] = number
        memories.correct(rows)
        np.testing.assert_array_equal(memories.estimate(), before)


def test_samples_with_rough_poses_are_forgotten_if_they_cannot_be_corrected(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-2))
    memories.push(0, 20)
    memories.map_to(team.poses)
    memories.correct(memories.told_of_another_load())
    memories.push(20, 40)
    fresh = Memories(config, team, team.poses)
    fresh.push(20, 40)
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-3, atol=1e-3)


def test_a_change_between_telling_and_correcting_leaves_the_new_load_alone(config: AgentConfig, team: Team) -> None:
    memories = with_a_fit_under_way(config, team)
    rows = memories.told()
    memories.push(40, 60, load=1.3)
    assert all(memory.changed_at == 40 for memory in memories.each)
    before = memories.grams()
    memories.correct(rows)
    np.testing.assert_array_equal(memories.grams(), before)
    memories.push(60, 61, load=1.3)
    fresh = Memories(config, team, team.poses)
    fresh.push(40, 61, load=1.3)
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-3, atol=1e-3)


def test_changes_are_found_again_after_a_fit_whether_or_not_all_tell_of_one_load(
    config: AgentConfig, team: Team
) -> None:
    for alike in (True, False):
        memories = Memories(config, team, moved(team, 1e-3))
        memories.push(0, 20)
        memories.fit(moved(team, 1e-5))
        memories.map_to(team.poses)
        rows = memories.told() if alike else memories.told_of_another_load()
        assert memories.push(20, 22) == 2 * [None]
        memories.correct(rows)
        assert memories.push(22, 40) == 18 * [None]
        found = [block for block in memories.push(40, 60, load=1.3) if block is not None]
        assert found == [40]
        assert memories.each[0].changed_at == 40


def test_no_change_is_found_before_poses_are_known(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-3))
    assert memories.push(0, 20) == 20 * [None]
    assert memories.push(20, 40, load=1.3) == 20 * [None]
    memories.fit(team.poses)
    # What came before cannot be told apart any more; that it is not what comes now does not stay unnoticed.
    memories.push(40, 60, load=1.3)
    fresh = Memories(config, team, team.poses)
    fresh.push(40, 60, load=1.3)
    np.testing.assert_allclose(memories.estimate()[0], fresh.estimate()[0], rtol=1e-2)


def test_everybody_ends_with_the_newest_change(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, team.poses)
    memories.push(0, 40)
    memory = memories.each[0]
    assert memory.changed_at == -1
    assert memory.adopt(21)
    assert not memory.adopt(21)
    assert not memory.adopt(8)
    assert memory.changed_at == 21
    memories.map_to(team.poses)
    changed_at, first, count = memories.told()[0, :3]
    assert changed_at == 21
    assert first >= 21
    assert 0 < count <= (40 - 21) * BLOCK
    # What is told stays the block that was agreed on, though this robot can tell only the next border from there:
    # else everybody would push everybody on.
    assert count % BLOCK == 0


def test_forgetting_follows_a_fit_too(config: AgentConfig, team: Team) -> None:
    settings = EfficientSettings(memory=2.0)
    forgetting = msgspec.structs.replace(config, efficient=settings)
    stale, _, corrected = errors_after_a_fit(forgetting, team, 2e-3)
    assert corrected < 0.01 * stale


def test_samples_that_come_again_count_as_if_they_had_come_once(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-2))
    memories.push(0, 20)
    memories.begin_again(team.poses)
    rows = memories.told()
    memories.push(20, 22)
    memories.push_early(10, 20)
    memories.correct(rows)
    memories.push_early(0, 10)
    assert memories.push(22, 40) == 18 * [None]
    fresh = Memories(config, team, team.poses)
    fresh.push(0, 40)
    assert [memory.count for memory in memories.each] == COUNT * [40 * BLOCK]
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-4, atol=1e-4)


def test_samples_can_come_again_before_any_has_counted(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-3))
    memories.begin_again(team.poses)
    assert all(memory.is_spoilt for memory in memories.each)
    memories.correct(memories.told())
    memories.push(0, 30)
    fresh = Memories(config, team, team.poses)
    fresh.push(0, 30)
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-4, atol=1e-4)


def test_what_comes_early_counts_only_when_it_has_been_tested_and_is_of_the_same_load(
    config: AgentConfig, team: Team
) -> None:
    memories = Memories(config, team, moved(team, 1e-4))
    memories.push(0, 20)
    memories.begin_again(team.poses)
    memories.correct(memories.told())
    memories.push(20, 24)
    for block in range(19, 9, -1):  # the load changed before block 14
        memories.push_early(block, block + 1, load=1.0 if block >= 14 else 0.7)
        before = memories.estimate()
        np.testing.assert_allclose(before[0], team.inertia.carried(team.poses[OWN].inverse()).mass, rtol=1e-2)
        memories.push(43 - block, 44 - block)
    assert memories.each[0].count == (34 - 14) * BLOCK
    np.testing.assert_allclose(memories.estimate()[0], team.inertia.mass, rtol=1e-3)


def test_what_was_forgotten_does_not_come_back_early(config: AgentConfig, team: Team) -> None:
    for forget in (lambda memory: memory.adopt(19), lambda memory: memory.forget_late(0.5)):
        memories = Memories(config, team, team.poses)
        memories.push(10, 20)
        memories.push_early(0, 10)
        for memory in memories.each:
            forget(memory)
        memories.push(20, 21)
        assert all(memory.count <= 10 * BLOCK for memory in memories.each)


def test_how_certain_a_new_load_is_follows_from_itself(config: AgentConfig, team: Team) -> None:
    """The motions' noise is felt the more the heavier a load is, whatever the load was before."""
    memories, fresh = (Memories(config, team, team.poses) for _ in range(2))
    memories.push(0, 20)
    memories.fit(team.poses)
    memories.push(20, 60, load=5.0)
    changed_at = memories.each[OWN].changed_at
    assert 20 <= changed_at <= 25
    fresh.push(changed_at, 40, load=5.0)
    fresh.fit(team.poses)
    fresh.push(40, 60, load=5.0)
    np.testing.assert_allclose(memories.deviations(), fresh.deviations(), rtol=0.02)


def test_what_was_felt_with_rough_poses_is_not_called_known(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, team.poses)
    memories.push(0, 40)
    memory = memories.each[0]
    assert memory.is_spoilt  # nobody knows how rough they are
    assert memory.adopt(21)
    assert memory.known_load() is None


def test_poses_count_as_uncertain_as_they_are_though_samples_were_forgotten_meanwhile(
    config: AgentConfig, team: Team
) -> None:
    memories = Memories(config, team, team.poses)
    memories.push(0, 40)
    memories.map_to(team.poses)
    rows = memories.told()
    for memory in memories.each:
        memory.forget_late(0.5)
    memories.correct(rows)
    assert not any(memory.is_spoilt for memory in memories.each)


def test_a_memory_that_fades_is_corrected_though_samples_come_again(config: AgentConfig, team: Team) -> None:
    fading = msgspec.structs.replace(config, efficient=EfficientSettings(memory=2.0))
    memories = Memories(fading, team, moved(team, 2e-3))
    memories.push(0, 30)
    memories.begin_again(team.poses)
    memories.correct(memories.told())
    memories.push_early(0, 30)
    memories.push(30, 60)
    fresh = Memories(fading, team, team.poses)
    fresh.push(0, 60)
    np.testing.assert_allclose(memories.estimate(), fresh.estimate(), rtol=1e-3, atol=1e-3)


def test_a_memory_that_fades_tells_nothing_as_long_as_another_load_fills_it(config: AgentConfig, team: Team) -> None:
    fading = msgspec.structs.replace(config, efficient=EfficientSettings(memory=2.0))
    memories = Memories(fading, team, team.poses)
    memories.push(0, 30)
    assert memories.estimate()[0] == pytest.approx(20.0, rel=1e-3)
    for block in range(30, 60):
        memories.push(block, block + 1, 1.3)
        payload, why = memories.each[OWN].payload(OWN, memories.team_poses())
        assert payload is None
        assert "do not fit" in why[0]


def test_what_is_seen_is_told_though_the_rest_is_not(config: AgentConfig) -> None:
    """A load that is carried about and only turns about the vertical shows one axis of its inertia."""
    team = make_team(3, count=COUNT, duration=DURATION, single_axis=True)
    memories = Memories(config, team, team.poses)
    memories.push(0, 60)
    for own, memory in enumerate(memories.each):
        payload, unseen = memory.payload(own, memories.team_poses())
        assert payload is not None
        assert payload.com is not None
        assert payload.tensor is None
        true = team.inertia.carried(team.poses[own].inverse())
        assert payload.mass == pytest.approx(true.mass, rel=1e-3)
        np.testing.assert_allclose(payload.com, true.com, atol=1e-3)
        assert payload.covariance.shape == (4, 4)
        assert unseen
        assert all(sentence.startswith("inertia about") for sentence in unseen)
