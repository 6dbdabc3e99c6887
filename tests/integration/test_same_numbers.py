"""Real processes in lockstep, and one process without a network: the same estimates, bit for bit."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest

from coheft.app.results.record import Record
from coheft.app.results.report import build_report
from coheft.app.run.inprocess import BlockRecord, run_in_process
from coheft.consensus.graph import build_graph
from coheft.estimation.tolerance import SensorTolerance
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Message
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import LoadChange, Scenario

PATIENCE = 60.0
M = TypeVar("M", bound=Message)


def in_processes(estimator: str, compliance: float, folder: Path) -> dict[str, object]:
    """What robots believe at the end, and at every second, as the command line reports it."""
    report = folder / "report.json"
    command = [
        sys.executable, "-m", "coheft", "run", "ring3", "--quiet", "--history", "--json", str(report),
        "--estimator", estimator, "--duration", "5", "--seed", "5", "--change", "t=3.5,mass=2,at=0.2,0.1,0.08",
        "--logs", str(folder / "logs"), "--set", f"sensors.tolerance.grasp_compliance={compliance}",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode in (0, 3), done.stderr
    loaded: dict[str, object] = json.loads(report.read_text())
    return loaded


def received(message: M) -> M:
    """As it would come over the wire: what the report computes of it depends on how arrays lie in memory."""
    return decode(encode(message, "key"), type(message), "key")


def in_one_process(scenario: Scenario, blocks: Iterable[BlockRecord]) -> dict[str, object]:
    """The same from a run in this process."""
    graph = build_graph(scenario.graph, scenario.robot_names)
    scene = Simulation(scenario, graph).scene
    scene = msgspec.structs.replace(
        scene, rotations=scene.rotations.copy(order="C"), translations=scene.translations.copy(order="C")
    )
    record = Record(scene, scenario.duration, with_history=True)
    for block in blocks:
        record.receive(received(block.truth))
        for estimate in block.estimates.values():
            record.receive(received(estimate))
    report = build_report(scenario, record, real_time_factor=1.0)
    loaded: dict[str, object] = json.loads(msgspec.json.encode(report))
    return loaded


@pytest.mark.smoke
@pytest.mark.parametrize(
    ("estimator", "compliance"),
    [("efficient", 0.0), pytest.param("efficient", 2e-5, marks=pytest.mark.slow), ("fan2017", 0.0)],
)
def test_the_same_numbers_in_one_process_and_in_many(estimator: str, compliance: float, tmp_path: Path) -> None:
    shipped = load_scenario("ring3")
    scenario = msgspec.structs.replace(
        shipped,
        sensors=msgspec.structs.replace(shipped.sensors, tolerance=SensorTolerance(grasp_compliance=compliance)),
        estimator=estimator,
        duration=5.0,
        seed=5,
        load_changes=(LoadChange(at=3.5, mass=2.0, position=(0.2, 0.1, 0.08)),),
    )
    one, many = in_one_process(scenario, run_in_process(scenario)), in_processes(estimator, compliance, tmp_path)
    for key in ("robots", "history", "load_changes", "consensus"):
        assert one[key] == many[key], key
