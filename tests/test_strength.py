"""Weights that arms cannot hold up are refused before anything is lost; what is said to be held is held."""

from __future__ import annotations

import re

import msgspec
import numpy as np
import pytest

from coheft.errors import LoadError, ScenarioError, SimulationError
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import parse_scenario
from coheft.wire.scenario.payload import Box, Payload
from coheft.wire.scenario.schema import Scenario
from coheft.wire.scenario.section import Vector
from coheft.wire.scenario.strength import Strength
from tests.physics_run import excitation, run, scenario

TWO = """
name = "two"
payload.boxes = [{ mass = %s, size = [0.8, 0.3, 0.1] }]
robots.grasps = [{ position = [-0.4, 0.0, 0.0] }, { position = [0.4, 0.0, 0.0], rotation_deg = [0, 0, 180] }]
graph.kind = "line"
"""
ABOVE, BESIDE, MIDDLE, BELOW = (0.0, 0.0, 0.3), (0.4, 0.3, 0.1), (0.0, 0.0, 0.0), (0.0, 0.0, -0.3)


def load(mass: float, place: Vector) -> Inertia:
    return Inertia.of_box(mass, (0.1, 0.1, 0.1), Pose(np.eye(3), np.array(place)))


def strength(chosen: Scenario) -> Strength:
    return Strength(chosen.robots.poses(), chosen.robots)


def expected(complaint: str) -> float:
    found = re.search(r"expected at most (.*) kg: masses are in kg$", complaint)
    assert found is not None, complaint
    return float(found[1])


def is_lost(chosen: Scenario, mass: float, place: Vector) -> bool:
    """With that dropped onto it while the robots move as they like."""
    simulation, references = Simulation(chosen), excitation(chosen)
    run(simulation, references, 3)
    simulation.inject(mass, place)
    try:
        run(simulation, references, round(5.0 / chosen.block_duration))
    except SimulationError:
        return True
    return False


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "place"),
    [("ring3", ABOVE), ("ring3", BESIDE), ("ring3", BELOW), ("mocobot_a", MIDDLE), ("line4", ABOVE)],
)
def test_what_is_refused_is_lost_and_what_is_said_to_be_held_is_held(
    name: str, place: Vector, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = scenario(name, rate=100, block=20)
    arms, payload = strength(chosen), chosen.payload.inertia()
    heavy = expected(arms.complaint(load(1e4, place), payload))
    while not (complaint := arms.complaint(load(heavy, place), payload)):
        heavy *= 1.2
    most = expected(complaint)
    assert 0.1 * heavy < most < heavy
    monkeypatch.setattr(Strength, "of", lambda *_: None)
    assert not is_lost(chosen, most, place)
    assert is_lost(chosen, heavy, place)


def test_a_payload_in_grams_is_refused() -> None:
    with pytest.raises(ScenarioError) as refused:
        parse_scenario(TWO % 6000, "two.toml")
    message = str(refused.value)
    assert message.startswith(
        "two.toml: key 'payload': found 6000 kg, which is more than 2 arms with 'robots.stiffness' = [800.0, 30.0] can "
        "hold up; expected at most "
    )
    parse_scenario(TWO % expected(message), "two.toml")


def test_a_payload_that_falls_while_it_settles_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The run would be lost in its first block."""
    heavy = scenario(payload=Payload(boxes=(Box(mass=1500.0, size=(0.6, 0.5, 0.1)),)))
    assert strength(heavy).complaint(heavy.payload.inertia())
    with pytest.raises(SimulationError, match="have lost the payload"):
        run(Simulation(heavy), excitation(heavy), 1)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        (["at = 5\nmass = 3500"], "load_changes[0].mass"),
        (["at = 5\nmass = 350", "at = 3\nmass = 350"], "load_changes[0].mass"),
        (["at = 3\nmass = 350", "at = 4\nmass = 350", "at = 5\nremove = 1"], "load_changes[1].mass"),
    ],
)
def test_loads_that_are_too_heavy_together_are_refused(changes: list[str], key: str) -> None:
    text = "\n".join([TWO % 6.0, *(f"[[load_changes]]\n{change}" for change in changes)])
    with pytest.raises(ScenarioError) as refused:
        parse_scenario(text, "two.toml")
    assert str(refused.value).startswith(f"two.toml: key '{key}': found ")
    assert "expected at most" in str(refused.value)


@pytest.mark.parametrize("change", ["at = 4\nremove = 1\n[[load_changes]]", "", "leak = 100\n[[load_changes]]"])
def test_what_has_gone_by_then_weighs_nothing(change: str) -> None:
    text = f"{TWO % 6.0}[[load_changes]]\nat = 1\nmass = 350\n"
    text += change if change.startswith("leak") else f"[[load_changes]]\n{change}"
    if change:
        parse_scenario(f"{text}\nat = 5\nmass = 350", "two.toml")
    else:
        with pytest.raises(ScenarioError, match="can hold up there"):
            parse_scenario(f"{text}\nat = 5\nmass = 350", "two.toml")


def test_a_load_in_grams_is_refused_and_the_run_goes_on() -> None:
    simulation = Simulation(scenario())
    with pytest.raises(LoadError, match=r"^mass of a load is 3000 kg at \(0.1, 0.0, 0.1\) m, which is more than 3"):
        simulation.inject(3000.0, (0.1, 0.0, 0.1))
    assert simulation.loads.states == []
    assert np.isfinite(simulation.advance({}).truth.samples).all()
    assert simulation.inject(3.0, (0.1, 0.0, 0.1)).id == 1


def test_only_arms_that_hold_the_payload_count() -> None:
    chosen = scenario()
    simulation = Simulation(chosen)
    complaint = strength(chosen).complaint(load(1e4, MIDDLE), chosen.payload.inertia())
    simulation.release("r1")
    simulation.release("r2")
    with pytest.raises(LoadError, match="more than one arm with") as refused:
        simulation.inject(1e4, MIDDLE)
    assert expected(str(refused.value)) < 0.5 * expected(complaint)


def test_hands_that_are_welded_hold_like_ropes() -> None:
    chosen = scenario("arms4")
    assert Strength.of(chosen.robots.poses(), chosen.robots) is None
    soft = msgspec.structs.replace(chosen.robots, arms="springs")
    assert Strength.of(chosen.robots.poses(), soft) is not None
