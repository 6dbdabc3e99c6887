"""Readings of all sensors of a run without agents, as the robots' reference motions do not depend on estimates."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from itertools import count, islice

import msgspec
import numpy as np

from coheft.agents.motion.reference import make_motion
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.config import agent_config
from coheft.wire.messages.structs import Reference
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.schema import Scenario

ReferenceOf = Callable[[int], Array]
"""Function from a block's number to its reference motion, see ``ReferenceMotion.reference``."""


@dataclass(frozen=True, eq=False)
class TeamSamples:
    """Truths of a run, one per block, and all sensors' samples (n, N, 15), columns as in ``MeasurementBlock``."""

    scene: Scene
    truths: tuple[Truth, ...]
    samples: Array


def simulate(scenario: Scenario) -> TeamSamples:
    """Return the samples that the agents of the same scenario receive, bit for bit.

    A ``ScenarioError`` says that the robots' motions depend on estimates.
    """
    if scenario.carry is not None:
        raise ScenarioError(
            f"scenario '{scenario.name}' has a section 'carry', but a study compares estimators on motions that do not "
            f"depend on them: leave it out, or choose another scenario"
        )
    simulation = Simulation(scenario, build_graph(scenario.graph, scenario.robot_names))
    truths, samples = [], []
    for result in islice(reference_blocks(scenario, simulation), scenario.blocks):
        truths.append(result.truth)
        samples.append(np.stack([each.samples for each in result.measurements.values()], axis=1))
    return TeamSamples(simulation.scene, tuple(truths), np.concatenate(samples))


def agents_references(scenario: Scenario) -> dict[str, ReferenceOf]:
    """The references of the scenario's agents, by robot."""
    graph = build_graph(scenario.graph, scenario.robot_names)
    return {name: make_motion(agent_config(scenario, name, tuple(graph[name]))).reference for name in graph}


def reference_blocks(
    scenario: Scenario, simulation: Simulation, references: Mapping[str, ReferenceOf] | None = None
) -> Iterator[BlockResult]:
    """Yield the blocks of a simulation with these references by robot, without end; None for those of its agents."""
    if references is None:
        references = agents_references(scenario)
    for block in count():
        yield simulation.advance(
            {
                name: Reference(robot=name, block=block, answers=block, motion=motion(block), wrench=np.zeros(6))
                for name, motion in references.items()
                if block >= scenario.lookahead
            }
        )


def with_exact_sensors(scenario: Scenario) -> Scenario:
    """Return the scenario with sensors without noise and errors."""
    exact = msgspec.structs.replace(scenario.sensors, noise_scale=0.0, errors="none")
    return msgspec.structs.replace(scenario, sensors=exact)
