"""The agent's core: what it is told, that it is deterministic, and that it survives bad blocks and lost messages."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, get_args

import msgspec
import numpy as np
import pytest

from coheft.agents.agent import Agent
from coheft.agents.motion.reference import Excitation
from coheft.consensus.graph import build_graph
from coheft.estimation.measurement import SAMPLE_SIZE, MeasurementBlock
from coheft.wire.config import AgentConfig, KnownPayload, agent_config
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import NeighbourMessage
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.motion import Motion, draw_waves
from coheft.wire.scenario.schema import Graph
from tests.in_process import assert_good, changed, run_with_faults

DURATION = 12.0
"""Long enough for three robots to find the poses (about 4 s) and the payload [s]."""


def settings(kind: Any) -> Iterator[tuple[str, ...]]:
    """Names of all fields of a struct, or of the structs within any other type; each after those that lead to it."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        for field in msgspec.structs.fields(kind):
            yield (field.name,)
            yield from ((field.name, *rest) for rest in settings(field.type))
    for part in get_args(kind):  # X | None, tuple[X, ...], dict[str, X]
        yield from settings(part)


def test_no_setting_of_an_agent_names_what_it_must_find_out() -> None:
    forbidden = {"n", "count", "robots", "members", "graph", "edges", "payload", "boxes", "mass", "loads", "grasps"}
    forbidden |= {"load_changes", "load_slots", "truth", "poses", "position", "duration", "reference_robot"}
    found = {".".join(names) for names in settings(AgentConfig) if names[-1] in forbidden}
    told = {"known.mass"}  # of whom a scenario says so, ``fan2017.known``: nothing otherwise
    assert found - told == {"motion.via_points.count"}  # of points, not of robots
    assert agent_config(load_scenario("ring3"), "r1", ("r2",)).known == KnownPayload()


def test_an_agent_is_told_the_same_whatever_is_held_by_how_many() -> None:
    ring6, other = load_scenario("ring6"), load_scenario("ring3")
    assert ring6.robots.perimeter is not None
    eight = msgspec.structs.replace(ring6.robots, perimeter=msgspec.structs.replace(ring6.robots.perimeter, count=8))
    changes = {
        "payload": other.payload,
        "load_changes": other.load_changes,
        "graph": Graph(kind="random"),
        "robots": eight,
    }
    told = agent_config(ring6, "r1", ("r2", "r6"))
    for key, value in changes.items():
        assert agent_config(msgspec.structs.replace(ring6, **{key: value}), "r1", ("r2", "r6")) == told


def test_equal_inputs_give_equal_outputs_bit_for_bit() -> None:
    scenario = load_scenario("ring3")
    graph = build_graph(scenario.graph, scenario.robot_names)
    rng = np.random.default_rng(1)
    teams = [{name: Agent(agent_config(scenario, name, graph[name])) for name in graph} for _ in range(2)]
    messages: list[dict[str, NeighbourMessage]] = [{}, {}]
    for block in range(40):
        samples = {name: rng.normal(size=(scenario.sensors.block, SAMPLE_SIZE)) for name in graph}
        answers = []
        for team, sent in zip(teams, messages, strict=True):
            outboxes = {
                name: agent.step(
                    block,
                    MeasurementBlock(block, samples[name].copy()),
                    # In whatever order messages come.
                    [sent[other] for other in graph[name][:: 1 if team is teams[0] else -1] if sent],
                )
                for name, agent in team.items()
            }
            sent.update({name: outbox.message for name, outbox in outboxes.items()})
            answers.append(
                [
                    encode(part, "key")
                    for outbox in outboxes.values()
                    for part in (outbox.message, outbox.reference, outbox.estimate)
                    if part is not None
                ]
            )
        assert answers[0] == answers[1]


def test_bad_blocks_are_survived() -> None:
    """One robot's sensors fail again and again, in the pose phase and after it: no one sees a load change in that."""
    recording = run_with_faults(
        changed("ring3", estimator="fan2017", duration=DURATION, load_changes=()),
        is_measured=lambda block, name: not (name == "r2" and block % 50 in (0, 1)),
    )
    assert_good(recording.judged(DURATION))
    for estimate in recording.last().values():
        assert estimate.converged
        assert estimate.load_changes == []


def test_lost_messages_are_survived() -> None:
    """The sums start anew; estimates stay as good as the messages that were lost allow."""
    losses = {(30, "r1", "r2"), (31, "r1", "r3"), (350, "r1", "r2"), (450, "r3", "r1")}
    recording = run_with_faults(
        changed("ring3", estimator="fan2017", duration=DURATION, load_changes=()),
        arrives=lambda block, to, sender: (block, to, sender) not in losses,
    )
    assert_good(recording.judged(DURATION))
    for estimates in recording.estimates.values():
        assert estimates[-1].converged
        assert estimates[-1].load_changes == []
        # After each loss the totals pause, then go on.
        assert estimates[-1].total_block > 500
        first = next(estimate.block for estimate in estimates if estimate.phase == "inertia")
        lags = np.array(
            [estimate.block - estimate.total_block for estimate in estimates if estimate.block > first + 30]
        )
        assert lags.min() < 20 < lags.max() < 50


def test_excitation_rates_are_the_derivatives() -> None:
    motion = Motion(translation=0.1, rotation=0.3, frequency=(0.4, 1.6), ramp=1.0)
    fine = Excitation(motion, draw_waves((0.4, 1.6), 3), rate=100_000, block=200_000).reference(0)
    numeric = (fine[2:, :6] - fine[:-2, :6]) * 0.5e5
    np.testing.assert_allclose(fine[1:-1, 6:], numeric, atol=1e-5)  # the ramp's end is a kink of the rates
    np.testing.assert_array_equal(fine[0], 0.0)
    assert (np.abs(fine[:, :6]).max(axis=0) <= [0.3] * 3 + [0.1] * 3).all()


@pytest.mark.parametrize("ramp", [0.0, 2.0])
def test_excitation_goes_on_from_block_to_block(ramp: float) -> None:
    excitation = Excitation(Motion(ramp=ramp), draw_waves((0.4, 1.6), 4), rate=500, block=10)
    whole = Excitation(Motion(ramp=ramp), draw_waves((0.4, 1.6), 4), rate=500, block=1000).reference(0)
    pieces = np.concatenate([excitation.reference(block) for block in range(100)])
    np.testing.assert_allclose(pieces, whole, atol=1e-12)
