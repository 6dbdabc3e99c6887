"""What a robot tells of load changes."""

from coheft.agents.fan2017.load_changes import LoadChanges
from coheft.wire.config import agent_config
from tests.in_process import changed


def of_a_robot() -> LoadChanges:
    return LoadChanges(agent_config(changed("ring3"), "r1", ("r2", "r3")))


def test_a_change_that_two_find_is_one() -> None:
    changes = of_a_robot()
    changes.notice(100, 104, within=2)
    first = changes.notices[-1]
    changes.notice(101, 106, within=2)
    assert len(changes.notices) == 1
    assert changes.notices[0].noticed_at == first.noticed_at
    assert changes.notices[0].changed_at > first.changed_at
    changes.notice(110, 113, within=2)
    assert len(changes.notices) == 2


def test_only_the_newest_are_remembered() -> None:
    changes = of_a_robot()
    for block in range(0, 1000, 10):
        changes.notice(block, block + 3, within=2)
    assert len(changes.notices) == 32
    assert changes.notices[-1].changed_at > changes.notices[0].changed_at > 0.0
