"""Motions that arms cannot follow are refused when the scenario is loaded: as the server would, and not sooner."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from coheft.agents.motion.common_path import CommonPath
from coheft.agents.motion.reference import make_motion
from coheft.consensus.graph import build_graph
from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import agent_config
from coheft.wire.scenario.file import load_scenario, parse_scenario
from coheft.wire.scenario.motion import Motion, ViaPoints
from coheft.wire.scenario.motion_checks import motion_complaints
from coheft.wire.scenario.reach import Reach
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import Scenario
from tests.physics_run import reference

BLOCKS = 1000


def changed(**motion: object) -> Scenario:
    ring6 = load_scenario("ring6")
    return msgspec.structs.replace(ring6, motion=msgspec.structs.replace(ring6.motion, **motion))


def most(scenario: Scenario) -> float:
    """What is expected at most where the scenario has too much."""
    with pytest.raises(ScenarioError) as refused:
        check(scenario, "x", motion_complaints)
    found = re.search(r"expected at most (.*), in ", str(refused.value))
    assert found is not None
    return float(found[1])


def refusals(scenario: Scenario) -> int:
    """Blocks of all robots in which the server would refuse what they ask for."""
    reach, graph = Reach(scenario.robots), build_graph(scenario.graph, scenario.robot_names)
    motions = [make_motion(agent_config(scenario, name, graph[name])) for name in scenario.robot_names]
    asked = [reference("r1", block, motion.reference(block)) for motion in motions for block in range(BLOCKS)]
    return sum(reach.excess(each) is not None for each in asked)


@pytest.mark.parametrize(
    ("key", "motion"),
    [
        ("translation", {}),
        ("rotation", {}),
        ("translation", {"axes": (0.0, 0.0, 0.0, 0.5, 3.0, 0.1), "rotation": 0.0}),
        ("rotation", {"frequency": (0.01, 0.02)}),
        ("translation", {"frequency": (0.01, 0.02), "ramp": 0.05}),
        ("translation", {"ramp": 0.0}),
        ("translation", {"via_points": ViaPoints()}),
        ("translation", {"via_points": ViaPoints(count=20, transit=(0.1, 0.2), dwell=(0.0, 0.1))}),
    ],
)
def test_what_is_not_refused_the_server_does_not_refuse_either(key: str, motion: dict[str, object]) -> None:
    limit = most(changed(**{**motion, key: 100.0}))
    good, bad = (changed(**{**motion, key: share * limit}) for share in (1.0, 2.0))
    check(good, "x", motion_complaints)
    assert refusals(good) == 0
    assert most(bad) == limit
    assert refusals(bad) > 0


@pytest.mark.parametrize(("key", "columns"), [("translation", slice(3, 6)), ("rotation_deg", slice(0, 3))])
def test_so_with_a_common_path(key: str, columns: slice) -> None:
    scenario = load_scenario("carry6")
    carry, reach = scenario.carry, Reach(scenario.robots)
    assert carry is not None

    def asked(size: float) -> tuple[Scenario, Array]:
        path = msgspec.structs.replace(carry, **{key: (0.0, size, 0.0)})
        time = np.arange(0.0, 60.0, 0.002)
        return msgspec.structs.replace(scenario, carry=path), np.hstack(CommonPath(path, path.start).displacement(time))

    limit = most(asked(5000.0)[0])
    good, motion = asked(limit)
    check(good, "x", motion_complaints)
    assert reach.excess(reference("r1", 0, motion)) is None
    assert np.abs(motion[:, columns]).max() > 0.5 * np.abs([2.0, 2.0 * np.pi]).min()
    assert reach.excess(reference("r1", 0, asked(1.1 * limit)[1])) is not None


@pytest.mark.parametrize("name", ["mocobot_a", "carry6"])
def test_rotations_of_motions_that_do_not_turn_do_not_matter(name: str) -> None:
    scenario = load_scenario(name)
    motion = msgspec.structs.replace(scenario.motion, axes=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0), rotation=1000.0)
    check(msgspec.structs.replace(scenario, motion=motion), "x", motion_complaints)


def test_motions_of_ones_own_are_not_known_here() -> None:
    scenario = load_scenario("ring6")
    check(msgspec.structs.replace(scenario, motion=Motion(own="sway", translation=60.0)), "x", motion_complaints)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (
            "translation = 60",
            "key 'motion.translation': found 60, which moves a hand up to 80.2 m from its home, its speed "
            "included; arms reach 2 m: expected at most 1.4, in metres, not millimetres",
        ),
        (
            "rotation = 12",
            "key 'motion.rotation': found 12, which moves a hand up to 17.1 rad from its home, its speed "
            "included; arms reach 6.28 rad: expected at most 4.4, in radians, not degrees",
        ),
    ],
)
def test_millimetres_and_degrees_are_named(keys: str, message: str) -> None:
    text = f"""
name = "two"
payload.boxes = [{{ mass = 6.0, size = [0.8, 0.3, 0.1] }}]
robots.grasps = [{{ position = [-0.4, 0.0, 0.0] }}, {{ position = [0.4, 0.0, 0.0] }}]
[motion]
{keys}
"""
    with pytest.raises(ScenarioError) as refused:
        parse_scenario(text, "two.toml")
    assert str(refused.value) == f"two.toml: {message}"
