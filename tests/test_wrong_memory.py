"""Whole runs in which something in an agent's memory is wrong for a moment: soon all are valid again."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from msgspec.structs import replace

from agents.agent import Agent
from agents.team import Team
from coheft.wire.estimator_settings import EfficientSettings
from tests.in_process import changed, steps

FROM = 4.0
"""When something goes wrong: all have been valid for a while [s]."""
SOON = 4.0
"""After that time all are valid again [s]."""


def statuses(
    monkeypatch: pytest.MonkeyPatch, spoil: Callable[[dict[str, Agent]], bool], soon: float = SOON, **changes: object
) -> list[set[str]]:
    """What all say of themselves, block after block; ``spoil`` is called until it has done something to the agents."""
    agents: dict[str, Agent] = {}
    original = Agent.__init__

    def remembered(self: Agent, *args: object, **kwargs: object) -> None:
        original(self, *args, **kwargs)  # type: ignore[arg-type]
        agents[self.config.name] = self

    monkeypatch.setattr(Agent, "__init__", remembered)
    last: dict[str, str] = {}
    found, spoilt_at = [], None
    for truth, outboxes in steps(changed("ring3", load_changes=(), duration=FROM + soon + 1.0, **changes)):
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
        told = fits._fits._rows[:, 1:]
        if not (told[0, 0] > fits.carried and (told[:, 0] == told[0, 0]).all()):
            return False
        told[1, 5] += 1.0
        return True

    found = statuses(monkeypatch, spoil)
    assert {"stale"} in found
    assert found[-1] == {"valid"}


@pytest.mark.parametrize("table", ["common", "scores", "fits", "wrenches", "misfits"])
def test_a_number_of_the_future_in_a_table_does_not_stop_fits_for_ever(
    monkeypatch: pytest.MonkeyPatch, table: str
) -> None:
    """It wins over all that robots tell until then."""
    teams: list[Team] = []

    def team_of(agent: Agent) -> Team:
        team: Team = agent._estimator._team  # type: ignore[attr-defined]
        return team

    def spoil(agents: dict[str, Agent]) -> bool:
        teams.extend(map(team_of, agents.values()))
        flood = team_of(agents["r2"])._floods._tables[table]
        flood._rows[1, 1] += 1000.0
        flood._news[1], flood._digest = None, None
        everybody.update(agents)
        return True

    everybody: dict[str, Agent] = {}
    found = statuses(monkeypatch, spoil, soon=8.0)
    assert found[-1] == {"valid"}
    for agent, before in zip(everybody.values(), teams, strict=True):
        team = team_of(agent)
        assert team is not before
        assert team._in_use.version > 0


def test_a_neighbour_that_seems_to_have_started_again_is_soon_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    def spoil(agents: dict[str, Agent]) -> bool:
        agents["r1"]._inbox._incarnations["r2"] += 64
        return True

    assert statuses(monkeypatch, spoil)[-1] == {"valid"}


@pytest.mark.parametrize(("refit_share", "soon"), [(0.01, SOON), (3.0, 12.0)], ids=["young", "as if old"])
def test_poses_that_are_told_to_be_fitted_but_are_not_are_not_called_well_known(
    monkeypatch: pytest.MonkeyPatch, refit_share: float, soon: float
) -> None:
    """One robot believes to have other samples than all others; in old teams the next fit would be long to come."""

    def spoil(agents: dict[str, Agent]) -> bool:
        agents["r2"]._estimator._team._fits.common._sure.gram[0, 0] += 4.0  # type: ignore[attr-defined]
        return True

    found = statuses(monkeypatch, spoil, soon, efficient=EfficientSettings(refit_share=refit_share))
    assert 0 < sum("stale" in each for each in found) < 100  # 2 s
    assert found[-1] == {"valid"}


@pytest.mark.parametrize("name", ["r1", "r3"], ids=["reference robot", "another one"])
def test_robots_that_are_ready_in_different_frames_agree_on_one(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """When r2 takes hold anew all have to be ready again; one that is before r2 says the number of another frame."""

    def spoil(agents: dict[str, Agent]) -> bool:
        r2, gossip = agents["r2"], agents[name]._gossip
        if r2._gossip.own.since == 0:
            r2.set_holding(True, r2.config.blocks(FROM) + 1)
        if not gossip.is_ready or gossip.start_block is not None:
            return False
        gossip._tell(replace(gossip.own, frame=gossip.own.frame + 1))
        return True

    found = statuses(monkeypatch, spoil)
    assert {"stale"} in found
    assert found[-1] == {"valid"}


def test_poses_of_a_fit_that_nobody_has_told_scores_for_make_no_agent_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """A number that somebody has wrong in all lines of the table."""

    def spoil(agents: dict[str, Agent]) -> bool:
        fits = agents["r1"]._estimator._team._fits  # type: ignore[attr-defined]
        told = fits._fits._rows[:, 1:]
        if not (told[0, 0] > fits.carried and (told[:, 0] == told[0, 0]).all()):
            return False
        for robot, row in enumerate(told[:, 1:].copy()):
            fits._fits.tell(robot, int(told[robot, 0]) + 2, row)
        return True

    found = statuses(monkeypatch, spoil, soon=8.0)
    assert found[-1] == {"valid"}
