"""Settings of the paper's method: each changes what comes out, and the payload is still found."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.app.results.judge import Judge
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.physics_server.simulation import Simulation
from coheft.wire.config import KnownPayload, agent_config
from coheft.wire.messages.structs import PayloadEstimate
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Graph
from tests.in_process import Recording, assert_good, changed, run_with_faults

DURATION = 8.0


def run(settings: Fan2017Settings) -> Recording:
    graph = Graph(kind="line")  # robots have one neighbour or two, so that weights of edges differ
    return run_with_faults(
        changed("ring3", estimator="fan2017", fan2017=settings, graph=graph, duration=DURATION, load_changes=())
    )


def believed(recording: Recording, robot: str) -> Array:
    """What a robot says first, when the guess still counts, shape (10,)."""
    return numbers(next(each.payload for each in recording.estimates[robot] if each.payload is not None))


def numbers(payload: PayloadEstimate) -> Array:
    assert payload.com is not None
    assert payload.tensor is not None
    return np.concatenate([[payload.mass], payload.com, pack_symmetric(payload.tensor)])


@pytest.fixture(scope="module")
def usual() -> Recording:
    return run(Fan2017Settings())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "inertia_pct"),
    [
        ({"acceleration": "gyro"}, 50.0),
        ({"share_acceleration": False}, 20.0),
        ({"share_estimates": False}, 20.0),
        ({"equation_weights": "constant"}, 20.0),
        ({"initial_mass": 20.0}, 12.0),
        ({"initial_com": "grasp"}, 12.0),
        ({"known": ("mass",)}, 12.0),
        ({"known": ("com", "inertia")}, 1e-6),
        ({"rounds": 40}, 12.0),
        ({"extrapolate": False}, 20.0),
        ({"memory": 5.0}, 12.0),
    ],
    ids=str,
)
def test_every_setting_counts(usual: Recording, settings: dict[str, object], inertia_pct: float) -> None:
    recording = run(Fan2017Settings(**settings))  # type: ignore[arg-type]
    assert_good(recording.judged(DURATION), inertia_pct=inertia_pct)
    assert all(np.abs(believed(recording, name) - believed(usual, name)).max() > 1e-7 for name in ("r1", "r2", "r3"))


def test_with_too_few_rounds_nothing_is_claimed() -> None:
    scenario = changed("ring6", estimator="fan2017", fan2017=Fan2017Settings(rounds=1), duration=6.0, load_changes=())
    for estimates in run_with_faults(scenario).estimates.values():
        assert estimates[-1].payload is not None
        assert any("fan2017.rounds" in reason for reason in estimates[-1].reasons)
        assert all(estimate.status != "valid" or estimate.payload is None for estimate in estimates)


@pytest.mark.parametrize("name", ["ring3", "line4"])
def test_each_robot_is_told_what_is_known_in_its_own_frame(name: str) -> None:
    scenario = changed(name, fan2017=Fan2017Settings(known=("mass", "com", "inertia")))
    graph = build_graph(scenario.graph, scenario.robot_names)
    simulation = Simulation(scenario, graph)
    judge = Judge(simulation.scene, [simulation.advance({}).truth])
    for robot, others in graph.items():
        known, truth = agent_config(scenario, robot, others).known, judge.payload(robot, 0)
        assert known.mass == pytest.approx(truth.mass)
        np.testing.assert_allclose(known.com, truth.com, atol=1e-9)
        np.testing.assert_allclose(known.inertia, pack_symmetric(truth.tensor), atol=1e-9)
    assert agent_config(load_scenario(name), "r1", ()).known == KnownPayload()


def test_parts_that_no_robot_can_know_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"key 'fan2017\.known\[0\]': expected one of .*\"com\".*; found \"weight\""
    ):
        load_scenario("ring3", ["fan2017.known=['weight']"])
