"""Whole runs in which something in an agent's memory is wrong for a moment: soon all are valid again."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from agents.agent import Agent
from tests.in_process import changed, steps

FROM = 4.0
"""When something goes wrong: all have been valid for a while [s]."""
SOON = 4.0
"""After that time all are valid again [s]."""


def statuses(monkeypatch: pytest.MonkeyPatch, spoil: Callable[[dict[str, Agent]], bool]) -> list[set[str]]:
    """What all say of themselves, block after block; ``spoil`` is called until it has done something to the agents."""
    agents: dict[str, Agent] = {}
    original = Agent.__init__

    def remembered(self: Agent, *args: object, **kwargs: object) -> None:
        original(self, *args, **kwargs)  # type: ignore[arg-type]
        agents[self.config.name] = self

    monkeypatch.setattr(Agent, "__init__", remembered)
    last: dict[str, str] = {}
    found, spoilt_at = [], None
    for truth, outboxes in steps(changed("ring3", load_changes=(), duration=FROM + SOON + 1.0)):
        last |= {name: each.estimate.status for name, each in outboxes.items() if each.estimate is not None}
        found.append(set(last.values()))
        if spoilt_at is None and truth.time > FROM and spoil(agents):
            spoilt_at = truth.time
    assert spoilt_at is not None
    return found


@pytest.mark.parametrize("mistaken", ["r0", "r7"])
def test_a_team_that_somebody_left_by_mistake_begins_anew(monkeypatch: pytest.MonkeyPatch, mistaken: str) -> None:
    """A letter of a neighbour's name is wrong, in a record that wins over the right one, or does not."""

    def spoil(agents: dict[str, Agent]) -> bool:
        gossip = agents["r1"]._gossip
        record = gossip.records["r2"]
        neighbours = tuple(mistaken if name == "r3" else name for name in record.neighbours)
        gossip.records["r2"] = replace(record, neighbours=neighbours)
        gossip._look_at_members()
        return True

    found = statuses(monkeypatch, spoil)
    assert {"stale"} in found
    assert found[-1] == {"valid"}


def test_poses_that_one_robot_cannot_use_are_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(agents: dict[str, Agent]) -> bool:
        fits = agents["r2"]._estimator._team._fits  # type: ignore[attr-defined]
        told = fits._fits._table
        if not (told[0, 0] > fits.carried and (told[:, 0] == told[0, 0]).all()):
            return False
        told[1, 4] += 1.0
        return True

    found = statuses(monkeypatch, spoil)
    assert {"stale"} in found
    assert found[-1] == {"valid"}
