"""Whole runs in one process, with faults in the sensors and the network, judged against the truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import msgspec
import numpy as np

from coheft.agents.agent import Outbox
from coheft.app.results.judge import Judge, RobotReport
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.consensus.graph import build_graph
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Scene, Truth
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import Scenario


def changed(name: str, **changes: object) -> Scenario:
    """A shipped scenario with some keys changed."""
    return msgspec.structs.replace(load_scenario(name), **changes)


@dataclass(frozen=True, eq=False)
class Recording:
    """All truths and estimates of a run."""

    scene: Scene
    truths: list[Truth]
    estimates: dict[str, list[Estimate]]

    def judged(self, time: float) -> dict[str, RobotReport]:
        """Every robot's last estimate before that time, against the truth."""
        judge = Judge(self.scene, self.truths)
        return {
            name: judge.robot([estimate for estimate in estimates if estimate.time <= time + 1e-9][-1])
            for name, estimates in self.estimates.items()
        }

    def last(self) -> dict[str, Estimate]:
        return {name: estimates[-1] for name, estimates in self.estimates.items()}


def steps(
    scenario: Scenario,
    is_measured: Callable[[int, str], bool] = lambda block, name: True,
    arrives: Callable[[int, str, str], bool] = lambda block, to, sender: True,
    anew: Mapping[int, Scenario] | None = None,
) -> Iterator[tuple[Truth, dict[str, Outbox]]]:
    """A run, block by block: the truth, and what every agent sends.

    Args:
        scenario: What to run.
        is_measured: Whether the sensors of a robot work in a block.
        arrives: Whether the message that ``sender`` sent after the block before reaches ``to``.
        anew: By block before which agents that know nothing take the place of the others: what they are told to do.
    """
    team = TeamInProcess(scenario)
    for block in range(scenario.blocks):
        chosen = (anew or {}).get(block)
        if chosen is not None:
            team.start_agents(chosen, incarnation=block)
        result = team.measure()
        samples = {name: each if is_measured(block, name) else None for name, each in measured(result).items()}
        heard = {
            name: [message for message in messages if arrives(block, name, message.sender)]
            for name, messages in team.received().items()
        }
        yield result.truth, team.answer(samples, heard)


def run_with_faults(
    scenario: Scenario,
    is_measured: Callable[[int, str], bool] = lambda block, name: True,
    arrives: Callable[[int, str, str], bool] = lambda block, to, sender: True,
) -> Recording:
    """Run a scenario.

    Args:
        scenario: What to run.
        is_measured: Whether the sensors of a robot work in a block.
        arrives: Whether the message that ``sender`` sent after the block before reaches ``to``.
    """
    scene = Simulation(scenario, build_graph(scenario.graph, scenario.robot_names)).scene
    recording = Recording(scene, [], {name: [] for name in scene.robots})
    for truth, outboxes in steps(scenario, is_measured, arrives):
        recording.truths.append(truth)
        for name, outbox in outboxes.items():
            if outbox.estimate is not None:
                recording.estimates[name].append(outbox.estimate)
    return recording


def assert_good(
    reports: dict[str, RobotReport], rotation_deg: float = 0.2, translation_mm: float = 5.0, inertia_pct: float = 12.0
) -> None:
    """Every robot: mass within 3 %, centre of mass 20 mm, and what else is asked for."""
    for name, report in reports.items():
        found = (report.mass.error_pct, report.com.error_mm, report.inertia.error_pct)
        assert None not in found, f"{name} has no estimate"
        assert (np.array(found, dtype=float) < [3.0, 20.0, inertia_pct]).all(), f"{name}: {found}"
        for other, pose in report.poses.items():
            assert pose.rotation_error_deg < rotation_deg, f"{name} of {other}: {pose}"
            assert pose.translation_error_mm < translation_mm, f"{name} of {other}: {pose}"
