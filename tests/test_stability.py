"""Arms that are too stiff for a light payload are refused, and what is proposed instead holds it."""

from __future__ import annotations

import ast
import re

import msgspec
import numpy as np
import pytest

from coheft.errors import ScenarioError, SimulationError
from coheft.physics_server import simulation
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.payload import Box, Payload
from coheft.wire.scenario.schema import Grasp, Robots, Scenario
from tests.physics_run import excitation, run, scenario

PLACES = ((0.1, 0.0, 0.0), (-0.08, 0.06, 0.02), (-0.08, -0.06, 0.02))


def light(mass: float) -> Scenario:
    base = scenario(payload=Payload(boxes=(Box(mass=mass, size=(0.2, 0.15, 0.05)),)))
    return with_robots(base, perimeter=None, grasps=tuple(Grasp(position=place) for place in PLACES))


def with_robots(base: Scenario, **changes: object) -> Scenario:
    return msgspec.structs.replace(base, robots=msgspec.structs.replace(base.robots, **changes))


@pytest.mark.parametrize("mass", [0.05, 0.5, 1.5])
def test_what_is_proposed_holds_the_payload(mass: float) -> None:
    with pytest.raises(ScenarioError, match="too stiff, or damped too strongly, for so light a payload") as refused:
        Simulation(light(mass))
    found = [tuple(ast.literal_eval(pair)) for pair in re.findall(r"\[[^]]*\]", str(refused.value))]
    assert found[:2] == [Robots().stiffness, Robots().damping]
    proposed = with_robots(light(mass), stiffness=found[2], damping=found[3])
    blocks = run(Simulation(proposed), excitation(proposed), 100)
    assert all(np.isfinite(block.truth.samples).all() for block in blocks)


@pytest.mark.parametrize("mass", [1.0, 2.0, 3.0, 4.0, 6.0, 10.0])
def test_just_those_are_refused_with_which_the_payload_flies_apart(
    mass: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    is_refused = False
    try:
        Simulation(light(mass))
    except ScenarioError:
        is_refused = True
    monkeypatch.setattr(simulation, "check", lambda *_: None)
    flies_apart = False
    try:
        run(Simulation(light(mass)), excitation(light(mass)), 200)
    except SimulationError:
        flies_apart = True
    assert is_refused == flies_apart
