"""Rows that a robot changes while it forwards them: believed in the open profile, found by seals in the secure one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from coheft.agents.agent import Agent
from coheft.agents.process.record_check import RecordCheck
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.app.run.keys import make_keys
from coheft.estimation.moments.rows import FORCE, A
from coheft.wire.config import agent_config
from coheft.wire.messages.structs import Estimate, NeighbourMessage
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.security import credentials_in
from coheft.wire.transport.signatures import Signatures
from tests.in_process import changed

EXTRA = 3.0
"""Mass that the liar adds [kg]."""
Change = Callable[[NeighbourMessage], NeighbourMessage]


def heavier(robot: int) -> Change:
    """What measures a point mass more at this robot's grasp: the rows still fit the motion of one body."""

    def change(said: NeighbourMessage) -> NeighbourMessage:
        channels = dict(said.channels)
        if "rows" in channels:
            rows = channels["rows"].copy()
            of_robot = channels["labels"][1:, 0] == robot
            rows[of_robot, FORCE] += np.float32(EXTRA) * rows[of_robot, A]
            channels["rows"] = rows
        return replace(said, channels=channels)

    return change


def without_seals(change: Change) -> Change:
    def without(said: NeighbourMessage) -> NeighbourMessage:
        said = change(said)
        channels = dict(said.channels)
        if "seals" in channels:
            seals = channels["seals"]
            channels["seals"] = seals[seals[:, 0] == 1]  # only its own
        return replace(said, channels=channels)

    return without


class SignedTeam(TeamInProcess):
    """A team whose robots sign records and rows, and one that changes what it tells another."""

    def __init__(self, scenario: Scenario, keys: Path | None) -> None:
        super().__init__(scenario)
        self._block_duration = scenario.block_duration
        self.problems: dict[str, list[str]] = {name: [] for name in self.graph}
        self._checks: dict[str, RecordCheck] = {}
        for name, others in self.graph.items():
            signatures = None if keys is None else Signatures("run", credentials_in(keys, name))
            self._checks[name] = RecordCheck(name, signatures)
            self.agents[name] = Agent(agent_config(scenario, name, others), signer=signatures)

    def run(self, seconds: float, change: Change | None = None) -> dict[str, list[Estimate]]:
        """Estimates of a stretch, while r2 changes what it tells r1."""
        estimates: dict[str, list[Estimate]] = {name: [] for name in self.graph}
        for _ in range(round(seconds / self._block_duration)):
            result = self.measure()
            heard = {
                name: [self._passed(message, name, change) for message in messages]
                for name, messages in self.heard().items()
            }
            for name, outbox in self.answer(measured(result), heard).items():
                self.problems[name] += outbox.problems
                if outbox.estimate is not None:
                    estimates[name].append(outbox.estimate)
        return estimates

    def _passed(self, message: NeighbourMessage, to: str, change: Change | None) -> NeighbourMessage:
        if change is not None and (message.sender, to) == ("r2", "r1"):
            message = change(message)
        signed = self._checks[message.sender].signed(list(message.gossip))
        return replace(message, gossip=self._checks[to].believed(signed, self.problems[to].append))


def wrong(estimates: list[Estimate], mass: float) -> list[float]:
    """When a valid mass was more than five standard deviations off."""
    return [
        each.time
        for each in estimates
        if each.status == "valid"
        and each.payload is not None
        and abs(each.payload.mass - mass) > 5 * np.sqrt(each.payload.covariance[0, 0])
    ]


def valid(estimates: list[Estimate]) -> float:
    return float(np.mean([each.status == "valid" and each.payload is not None for each in estimates]))
