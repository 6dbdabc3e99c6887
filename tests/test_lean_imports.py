"""What a process does not need it does not load: there is one per robot, on machines that may be small."""

from __future__ import annotations

import subprocess
import sys

import msgspec
import pytest

from coheft.wire.config import agent_config
from coheft.wire.scenario.file import load_scenario


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        (
            "coheft.agents.process.main",
            {"scipy", "mujoco", "coheft.physics_server", "cyclopts", "rich", "unittest", "coheft.wire.cart"},
        ),
        ("coheft.physics_server.server", {"coheft.agents", "cyclopts", "rich", "matplotlib", "scipy"}),
        ("coheft.consensus", {"zenoh", "msgspec", "mujoco", "scipy", "coheft.agents", "coheft.app"}),
        ("coheft.app.cli.main", {"zenoh", "mujoco", "numpy", "scipy", "matplotlib", "joblib"}),
    ],
)
def test_what_is_not_loaded(module, heavy):
    code = f"import {module}, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert heavy & set(loaded) == set()


def test_consensus_as_a_library_loads_nothing_of_robots_and_scenarios():
    code = "import coheft.consensus, sys; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    others = {name for name in loaded if name.startswith("coheft.") and not name.startswith("coheft.consensus")}
    geometry = {"coheft.estimation.geometry", "coheft.estimation.geometry.spatial"}
    limits = {"coheft.wire", "coheft.wire.messages", "coheft.wire.messages.limits"}
    assert others <= {"coheft.errors", "coheft.estimation"} | geometry | limits


def test_with_its_first_step_an_agent_loads_no_more():
    scenario = load_scenario("ring3")
    config = agent_config(scenario, scenario.robot_names[0], scenario.robot_names[1:])
    code = (
        "import sys, msgspec, numpy\n"
        "from coheft.agents.process.main import Agent, MeasurementBlock\n"
        "from coheft.wire.config import AgentConfig\n"
        "config = msgspec.json.decode(sys.stdin.buffer.read(), type=AgentConfig)\n"
        "Agent(config).step(0, MeasurementBlock(0, numpy.zeros((config.block, 15))), [])\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], input=msgspec.json.encode(config), capture_output=True)
    assert done.returncode == 0, done.stderr.decode()
    assert {"numpy.random", "hashlib", "scipy"} & set(done.stdout.decode().split()) == set()
