"""Dynamic consensus between real processes, each in coordinates of its own: as fast and as exact as theory says."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from coheft.app.run.observer import set_link
from coheft.consensus import Neighbours, convergence_rate, lag_bound, metropolis_matrix
from coheft.consensus.graph import build_graph
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.requests import HoldRequest, StatusRequest
from coheft.wire.scenario.schema import Graph

from .consensus_agent import Inputs
from .team import Team, running_team, small_scenario, wait_until

pytestmark = pytest.mark.slow
AGENT = (str(Path(__file__).with_name("consensus_agent.py")),)
BLOCKS = 120


class Watched:
    """A team whose agents add up what ``inputs`` says, and what they have written of it."""

    def __init__(self, team: Team, graph: Neighbours, inputs: Inputs) -> None:
        self.team, self.graph, self.inputs = team, graph, inputs

    def lines(self, name: str) -> list[dict[str, Any]]:
        """All whole lines of a robot's newest log."""
        newest = max(self.team.folder.glob(f"{name}.*.jsonl"), default=None)
        text = "" if newest is None else newest.read_text()
        return [json.loads(line) for line in text[: text.rfind("\n") + 1].splitlines()]

    def finished(self) -> dict[int, Array]:
        """By block at which it left: what all have, in the common frame, shape (N, 6).

        Of the longest time between two starts: where a machine is busy a message may be late, and sums begin anew.
        """
        by_start: dict[int, dict[int, list[Array]]] = {}
        for name in self.graph:
            for line in self.lines(name):
                if line["finished"] is not None:
                    value = self.inputs.to_common(name) @ np.array(line["finished"])
                    by_start.setdefault(line["start"], {}).setdefault(line["block"], []).append(value)
        longest = max(by_start.values(), key=len)
        return {block: np.array(each) for block, each in sorted(longest.items()) if len(each) == len(self.graph)}

    def begun(self) -> int:
        """The block after which the sums have begun last."""
        return int(self.lines("r1")[-1]["start"])

    def wrenches(self, block: int) -> Array:
        """All inputs in the common frame, shape (N, 6)."""
        return np.array([self.inputs.wrench(name, block) for name in self.graph])

    def is_settled(self, members: list[str], after: int) -> bool:
        """Whether those have, later than a block, the mean of what they put in."""
        found = []
        for name in members:
            lines = self.lines(name)
            if not lines or lines[-1]["finished"] is None or lines[-1]["block"] <= after:
                return False
            if lines[-1]["members"] != len(members):
                return False
            found.append(self.inputs.to_common(name) @ np.array(lines[-1]["finished"]))
        mean = np.mean([self.inputs.wrench(name, after) for name in members], axis=0)
        return bool(np.abs(np.array(found) - mean).max() < 1e-9)


@contextmanager
def adding_up(
    folder: Path, graph: Graph, count: int, rounds: int, frames: int, duration: float = 1e4, **inputs: Any
) -> Iterator[Watched]:
    folder.mkdir()
    rng = np.random.default_rng(7)
    scenario = small_scenario(count, graph.kind, duration)
    names = scenario.robot_names
    values = {name: rng.normal(size=6).tolist() for name in names}
    rng = np.random.default_rng(frames)
    told = Inputs(rounds, {name: rng.normal(size=6).tolist() for name in names}, values, **inputs)
    (folder / "inputs.json").write_bytes(msgspec.json.encode(told))
    scenario = msgspec.structs.replace(scenario, estimator="fan2017")
    with running_team(scenario, folder, agent_command=AGENT) as team:
        yield Watched(team, build_graph(graph, names), told)


def added_up(folder: Path, graph: Graph, count: int, rounds: int, frames: int, **inputs: Any) -> Watched:
    """A team that has come to its end."""
    with adding_up(folder, graph, count, rounds, frames, duration=4.0, **inputs) as watched:
        for name in watched.graph:
            assert watched.team.exit_status(name) == 0, watched.team.log(name)
    return watched


TEAMS = {"ring of 6, 1 round": (Graph(kind="ring"), 6, 1), "line of 4, 3 rounds": (Graph(kind="line"), 4, 3)}


@pytest.fixture(scope="module", params=TEAMS)
def team(request: pytest.FixtureRequest) -> str:
    """Its name."""
    return str(request.param)


@pytest.fixture(scope="module")
def constant(team: str, tmp_path_factory: pytest.TempPathFactory) -> Watched:
    """Inputs that stay."""
    return added_up(tmp_path_factory.mktemp("constant") / "one", *TEAMS[team], frames=1)


def test_disagreement_falls_per_round_by_the_second_eigenvalue(constant: Watched) -> None:
    rounds, rate = constant.inputs.rounds, convergence_rate(metropolis_matrix(constant.graph))
    mean = constant.wrenches(0).mean(axis=0)
    passes = list(constant.finished().values())[::rounds]  # those between them have been begun in between
    apart = np.array([np.linalg.norm(values - mean) for values in passes])
    last = int(np.flatnonzero(apart > 1e-9)[-1])  # what is less is rounding
    early = last // 2  # by then only the slowest part is left
    assert last - early >= 3
    per_round = (apart[last] / apart[early]) ** (1.0 / (rounds * (last - early)))
    assert per_round == pytest.approx(rate, rel=0.05)


def test_sums_are_conserved_from_block_to_block(constant: Watched) -> None:
    sums = np.array([values.sum(axis=0) for values in constant.finished().values()])
    assert np.abs(np.diff(sums, axis=0)).max() < 1e-12
    np.testing.assert_allclose(sums[0], constant.wrenches(0).sum(axis=0), atol=1e-12)


@pytest.mark.parametrize("team", ["line of 4, 3 rounds"], indirect=True)
def test_no_frame_matters(team: str, constant: Watched, tmp_path: Path) -> None:
    """All frames are turned and moved: block for block, what agents have is the same in common coordinates."""
    turned = added_up(tmp_path / "turned", *TEAMS[team], frames=2)
    assert turned.inputs.values == constant.inputs.values
    assert turned.inputs.frames != constant.inputs.frames
    pairs = list(zip(constant.finished().values(), turned.finished().values(), strict=False))
    assert len(pairs) >= BLOCKS
    for one, other in pairs:
        np.testing.assert_allclose(one, other, atol=1e-9)


def test_moving_inputs_are_followed_within_the_bound(tmp_path: Path) -> None:
    rounds, swing = 4, 80
    watched = added_up(tmp_path / "moving", Graph(kind="ring"), 6, rounds, frames=1, swing=swing)
    moved = np.array([watched.wrenches(block + rounds) - watched.wrenches(block) for block in range(swing)])
    moved -= moved.mean(axis=1, keepdims=True)
    rate = convergence_rate(metropolis_matrix(watched.graph))
    bound = lag_bound(rate, rounds, float(np.linalg.norm(moved, axis=1).max()))
    finished = watched.finished()
    steady = [block for block in finished if block > min(finished) + swing]
    off = [
        np.linalg.norm(finished[block] - watched.wrenches(block - rounds).mean(axis=0), axis=0).max()
        for block in steady
    ]
    assert len(steady) > swing
    assert 0.1 * bound < max(off) <= bound, "the bound is of use, and holds"


def test_it_converges_anew_after_a_cut_link_and_after_a_join(tmp_path: Path) -> None:
    changes = {"r2": [1.0, -2.0, 0.5, 0.3, 0.0, 4.0]}
    changed_at = 400
    graph, everyone = Graph(kind="ring"), ["r1", "r2", "r3", "r4"]
    with adding_up(tmp_path / "cut", graph, 4, 2, frames=1, changes=changes, changed_at=changed_at) as watched:
        team = watched.team
        wait_until(lambda: watched.is_settled(everyone, 0), "the first sum")
        assert watched.lines("r1")[-1]["block"] < changed_at, "the input has changed too early for this test"
        begun = watched.begun()
        run_file, scene = team.plan.run_file(), team.ask(StatusRequest()).scene
        set_link(run_file, scene, "r1", "r2", cut=True)
        wait_until(lambda: watched.lines("r3")[-1]["finished"] is None, "those who are not at the link to notice")
        team.wait_for_block(changed_at + 50)
        assert not any(watched.is_settled([name], changed_at) for name in everyone)
        set_link(run_file, scene, "r1", "r2", cut=False)
        wait_until(lambda: watched.is_settled(everyone, changed_at), "the new sum")
        assert watched.begun() > begun

        block = team.ask(HoldRequest(robot="r4", holding=False)).block
        left = ["r1", "r2", "r3"]
        wait_until(lambda: watched.is_settled(left, block), "the sum of those who still hold the load")
        block = team.ask(HoldRequest(robot="r4", holding=True)).block
        wait_until(lambda: watched.is_settled(everyone, block), "the sum with who has come back")
