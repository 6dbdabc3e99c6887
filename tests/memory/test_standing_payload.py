"""What has been published stands until there is something new to say."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from agents.late_wrenches import LateWrenches
from agents.seen_payload import SeenPayload, StandingPayload
from coheft.estimation.inertia import FEATURES, InertiaModel, packed_gram
from coheft.wire.config import AgentConfig
from coheft.wire.estimator_settings import EfficientSettings
from tests.estimation.team import Team
from tests.memory.memories import OWN, Memories, moved

ONE, OTHER = object(), object()


class Solving:
    """Counts the solutions."""

    def __init__(self) -> None:
        self.count = 0
        self.standing = StandingPayload()

    def is_new(self, count: float, of: object = ONE, number: float = 1.0) -> bool:
        before = self.count
        self.standing.find(count, (of,), (number,), self._solve)
        return self.count > before

    def _solve(self) -> SeenPayload:
        self.count += 1
        return SeenPayload(None, (str(self.count),))


def test_it_stands_while_samples_grow_by_little() -> None:
    solving = Solving()
    assert [solving.is_new(count) for count in (1000.0, 1000.0, 1015.0, 1025.0, 1040.0)] == [
        True,
        False,
        False,
        True,
        False,
    ]


def test_it_is_found_anew_when_anything_is_another() -> None:
    solving = Solving()
    assert solving.is_new(1000.0)
    assert solving.is_new(999.0)  # something was forgotten
    assert solving.is_new(999.0, of=OTHER)
    assert solving.is_new(999.0, of=OTHER, number=2.0)
    assert not solving.is_new(999.0, of=OTHER, number=2.0)
    solving.standing.drop()
    assert solving.is_new(999.0, of=OTHER, number=2.0)
    assert [solving.is_new(np.nan) for _ in range(2)] == [True, True]


def test_a_robot_goes_on_saying_the_same_until_it_knows_better(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, team.poses)
    poses = memories.team_poses()
    memories.push(0, 51)
    first = memories.each[OWN].payload(OWN, poses)
    assert first.payload is not None
    memories.push(51, 52)  # 2 % more samples, and no more
    assert memories.each[OWN].payload(OWN, poses) is first
    memories.push(52, 53)
    later = memories.each[OWN].payload(OWN, poses)
    assert later.payload is not None
    assert np.all(later.payload.covariance.diagonal() < first.payload.covariance.diagonal())


def test_corrections_and_changes_are_told_at_once(config: AgentConfig, team: Team) -> None:
    memories = Memories(config, team, moved(team, 1e-3))
    memories.push(10, 30)
    memories.map_to(team.poses)
    poses, memory = memories.team_poses(), memories.each[OWN]
    mapped = memory.payload(OWN, poses)
    memories.correct(memories.told(), variance=1e-7)
    corrected = memory.payload(OWN, poses)
    assert corrected is not mapped
    assert memory.payload(OWN, poses) is corrected
    memory.adopt(5)  # of a load before all samples: none is forgotten, but what was corrected before is not of this one
    assert memory.payload(OWN, poses) is not corrected


def test_a_memory_that_fades_is_always_solved_anew(config: AgentConfig, team: Team) -> None:
    fading = msgspec.structs.replace(config, efficient=EfficientSettings(memory=2.0))
    memories = Memories(fading, team, team.poses)
    memories.push(0, 50)
    poses = memories.team_poses()
    assert memories.each[OWN].payload(OWN, poses) is not memories.each[OWN].payload(OWN, poses)


def test_late_wrenches_are_held_against_a_load_that_is_found_anew_now_and_then(config: AgentConfig, team: Team) -> None:
    late = LateWrenches(10.0)
    assert late.need_solution(100.0)
    memories = Memories(config, team, team.poses)
    memories.push(0, 30)
    window, model = memories.each[OWN]._window, memories.each[OWN]._weights.model
    late.solve(model, window.information(model))
    assert [late.need_solution(count) for count in (299.0, 300.0, 306.0, 307.0, np.nan)] == [
        True,
        False,
        False,
        True,
        True,
    ]
    rng = np.random.default_rng(2)
    nonsense = packed_gram(np.hstack([np.ones((20, 1)), rng.normal(size=(20, 18))]))
    assert late.surprise(model, nonsense) > 10.0
    assert late.surprise(model, memories.sums(40, 1.0)[OWN][: len(nonsense)]) == pytest.approx(0.0, abs=1e-3)


def test_wrenches_contradict_nothing_once_the_load_is_forgotten() -> None:
    model = InertiaModel(np.eye(6), np.eye(6))
    rows = np.random.default_rng(1).normal(size=(500, FEATURES))
    rows[:, 0] = 1.0
    late = LateWrenches(blocks_per_second=10.0)
    late.solve(model, model.information(packed_gram(rows)))
    far = np.concatenate([[10.0], np.zeros(FEATURES - 7), np.full(6, 1e4)])
    late.add(far)
    late.compare(model, np.zeros((6, 6)))
    assert late.contradict
    late.forget_solution()
    assert not late.contradict
