"""Rows that a robot changes while it forwards them: believed in the open profile, found by seals in the secure one."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from coheft.agents.agent import Agent
from coheft.agents.efficient.handover import CHANNEL
from coheft.agents.efficient.seals import Seal
from coheft.agents.estimator import Channels
from coheft.agents.process.record_check import RecordCheck
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.app.run.keys import make_keys
from coheft.estimation.moments.rows import FORCE, A
from coheft.wire.config import agent_config
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import Estimate, LinkState, NeighbourMessage
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
    """A team whose robots sign records and rows, with links that lose messages, and a robot that changes them.

    Attributes:
        loses: Share of the messages that are lost.
        holds_back: Number of blocks by which messages from r2 to r1 are late while r2 changes them.
        cut: The two robots whose link is cut.
        problems: What each robot has refused.
    """

    def __init__(self, scenario: Scenario, keys: Path | None) -> None:
        super().__init__(scenario)
        self._scenario, self._keys = scenario, keys
        self._block_duration = scenario.block_duration
        self._random = random.Random(5)
        self.loses = 0.0
        self.holds_back = 0
        self._held_back = deque[NeighbourMessage]()
        self.cut = set[str]()
        self.problems: dict[str, list[str]] = {name: [] for name in self.graph}
        self._checks: dict[str, RecordCheck] = {}
        for name in self.graph:
            self.start(name, 0)

    def start(self, name: str, incarnation: int) -> None:
        """Start an agent that knows nothing."""
        signatures = None if self._keys is None else Signatures("run", credentials_in(self._keys, name))
        self._checks[name] = RecordCheck(name, signatures)
        config = agent_config(self._scenario, name, self.graph[name])
        self.agents[name] = Agent(config, incarnation, signer=signatures)

    def run(self, seconds: float, change: Change | None = None) -> dict[str, list[Estimate]]:
        """Estimates of a stretch, while r2 changes what it tells r1."""
        estimates: dict[str, list[Estimate]] = {name: [] for name in self.graph}
        for _ in range(round(seconds / self._block_duration)):
            result = self.measure()
            heard = {
                name: [self._passed(message, name, change) for message in messages if self._arrives(message, name)]
                for name, messages in self.received().items()
            }
            if change is not None and self.holds_back:
                self._held_back += [message for message in heard["r1"] if message.sender == "r2"]
                heard["r1"] = [message for message in heard["r1"] if message.sender != "r2"]
                if len(self._held_back) > self.holds_back:
                    heard["r1"].append(self._held_back.popleft())
            for name, outbox in self.answer(measured(result), heard).items():
                self.problems[name] += outbox.problems
                if outbox.estimate is not None:
                    estimates[name].append(outbox.estimate)
        return estimates

    def _arrives(self, message: NeighbourMessage, to: str) -> bool:
        return {message.sender, to} != self.cut and self._random.random() >= self.loses

    def _passed(self, message: NeighbourMessage, to: str, change: Change | None) -> NeighbourMessage:
        if change is not None and (message.sender, to) == ("r2", "r1"):
            message = change(message)
        signed = self._checks[message.sender].signed(list(message.gossip))
        return replace(message, gossip=self._checks[to].believed(signed, self.problems[to].append))


MASS = 8.0
"""Of what ``line4`` holds [kg]."""


def wrong(estimates: list[Estimate]) -> list[float]:
    """Times at which a valid mass was more than five standard deviations off."""
    return [
        each.time
        for each in estimates
        if each.status == "valid"
        and each.payload is not None
        and abs(each.payload.mass - MASS) > 5 * np.sqrt(each.payload.covariance[0, 0])
    ]


def valid(estimates: list[Estimate]) -> float:
    return float(np.mean([each.status == "valid" and each.payload is not None for each in estimates]))


def quiet(name: str) -> Scenario:
    return changed(name, load_changes=())


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("keys") / "team"
    make_keys(folder, quiet("ring6"))
    return folder


def test_in_the_open_profile_a_consistent_lie_in_the_middle_of_a_line_is_believed() -> None:
    team = SignedTeam(quiet("line4"), None)
    team.run(2.0)
    assert len(wrong(team.run(2.0, heavier(2))["r1"])) > 10


@pytest.mark.slow
@pytest.mark.parametrize("lie", [heavier(2), without_seals(heavier(2))], ids=["with seals", "without seals"])
def test_rows_that_their_robot_has_not_signed_are_removed(keys: Path, lie: Change) -> None:
    team = SignedTeam(quiet("line4"), keys)
    team.run(2.0)
    lying = team.run(4.0, lie)
    assert all(time < 2.0 + 1.5 for time in wrong(lying["r1"]))
    assert valid(lying["r1"][-20:]) == 0.0  # nothing of r3 and r4 comes from elsewhere
    assert valid(lying["r3"]) == 1.0
    assert any("r3" in problem for problem in team.problems["r1"])
    after = team.run(4.0)["r1"]
    assert not wrong(after)
    assert valid(after[-5:]) == 1.0


@pytest.mark.slow
def test_who_tells_false_rows_late_is_named_and_distrusted(keys: Path) -> None:
    team = SignedTeam(quiet("line4"), keys)
    team.holds_back = 1
    team.run(2.0)
    team.run(2.0, heavier(2))
    problems = [problem for problem in team.problems["r1"] if "has not signed" in problem]
    assert problems
    assert all(problem.startswith("refused from r2: rows of r3") for problem in problems)


@pytest.mark.slow
def test_in_a_ring_the_other_way_round_serves(keys: Path) -> None:
    team = SignedTeam(quiet("ring6"), keys)
    team.run(2.0)
    lying = team.run(6.0, heavier(2))
    assert any("refused from r2: rows of r3" in problem for problem in team.problems["r1"])
    assert valid(lying["r1"][-10:]) == 1.0
    assert all(valid(lying[name][-10:]) == 1.0 for name in lying)


def test_seals_change_no_number(keys: Path) -> None:
    secure, plain = (SignedTeam(quiet("ring3"), each).run(1.2) for each in (keys, None))
    for name, estimates in plain.items():
        assert [encode(each, "key") for each in secure[name]] == [encode(each, "key") for each in estimates]


@pytest.mark.slow
def test_in_the_secure_profile_a_newcomer_believes_no_conclusion_of_a_neighbour(keys: Path) -> None:
    told: list[tuple[int, Channels]] = []

    def note(said: NeighbourMessage) -> NeighbourMessage:
        told.append((said.block, said.channels))
        return said

    def handed_over(said: NeighbourMessage) -> NeighbourMessage:
        known = {name: array for block, each in told if block == said.block for name, array in each.items()}
        return replace(
            said, channels=dict(said.channels) | {CHANNEL: known[CHANNEL]} if CHANNEL in known else said.channels
        )

    def restarted(keys: Path | None, change: Change | None) -> list[Estimate]:
        team = SignedTeam(quiet("ring3"), keys)
        team.run(1.6)
        team.start("r1", 1)
        return team.run(0.5, change)["r1"]

    assert any(each.payload is not None for each in restarted(None, note))
    assert any(CHANNEL in each for _, each in told)
    secure = restarted(keys, handed_over)
    assert all(each.payload is None for each in secure)


@pytest.mark.slow
def test_lost_messages_are_no_missing_signatures(keys: Path) -> None:
    team = SignedTeam(quiet("line4"), keys)
    team.loses = 0.2
    team.run(10.0)
    assert not any(team.problems.values())


@pytest.mark.slow
def test_what_was_known_before_a_cut_link_is_kept(keys: Path) -> None:
    team = SignedTeam(quiet("line4"), keys)
    before = team.run(4.0)["r1"][-1]
    team.cut = {"r3", "r4"}
    team.run(3.0)
    team.cut = set()
    again = next(each for each in team.run(1.0)["r1"] if each.status == "valid")
    for name, pose in before.poses.items():
        assert np.trace(again.poses[name].covariance) < 1.3 * np.trace(pose.covariance)


def test_a_seal_comes_back_from_its_bytes() -> None:
    seal = Seal(3, -5, bytes(range(80)), b"signature")
    assert Seal.decode(seal.encode()) == seal


@pytest.mark.parametrize("data", [bytes(84), b"\xff" * 164, bytes(range(164))])
def test_any_bytes_are_a_seal_that_no_robot_has_signed(keys: Path, data: bytes) -> None:
    seal = Seal.decode(data)
    assert not Signatures("run", credentials_in(keys, "r1")).is_signed_by("r3", seal.content(1), seal.signature)


def test_a_signature_is_of_one_robot_one_run_and_one_content(keys: Path) -> None:
    of_r3, of_r1 = (Signatures("run", credentials_in(keys, name)) for name in ("r3", "r1"))
    signature = of_r3.sign(b"rows")
    assert not of_r1.is_signed_by("r3", b"rows", signature)  # it has not seen a certificate of r3 yet
    for signer in (of_r3, of_r1):
        record = signer.signed(LinkState("r3" if signer is of_r3 else "r1", 1, ("r2",)))
        assert of_r1.problem(record) is None
    assert of_r1.is_signed_by("r3", b"rows", signature)
    assert not of_r1.is_signed_by("r3", b"other rows", signature)
    assert not of_r1.is_signed_by("r1", b"rows", signature)
    other_run = Signatures("another run", credentials_in(keys, "r3"))
    assert not of_r1.is_signed_by("r3", b"rows", other_run.sign(b"rows"))
