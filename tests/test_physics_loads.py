"""Loads put onto the moving payload and taken away."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import mujoco
import numpy as np
import pytest

from coheft.errors import LoadError, ScenarioError, SimulationError
from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion
from coheft.estimation.measurement import ACCELERATION, GYRO
from coheft.estimation.rigid_body.mass_properties import Inertia, combined
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.payload_extent import load_place_complaints
from coheft.wire.scenario.reach import Reach
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import LoadChange, Scenario
from coheft.wire.scenario.section import Vector
from tests.physics_run import excitation, reference, run, scenario


def moving(chosen: Scenario | None = None) -> Simulation:
    """A simulation whose payload moves and turns."""
    chosen = scenario("ring6") if chosen is None else chosen
    simulation = Simulation(chosen)
    run(simulation, excitation(chosen), 40)
    assert np.linalg.norm(simulation.data.qvel[:3]) > 0.05
    assert np.linalg.norm(simulation.data.qvel[3:]) > 0.05
    return simulation


def momentum(simulation: Simulation, parts: list[Inertia]) -> Array:
    """Linear momentum, and angular momentum about the world's origin, of parts that are fixed to the payload."""
    data = simulation.data
    rotation, position = rotation_from_quaternion(data.qpos[3:7]), data.qpos[:3]
    w = rotation @ data.qvel[3:]
    total = np.zeros(6)
    for part in parts:
        arm = rotation @ part.com
        linear = part.mass * (data.qvel[:3] + np.cross(w, arm))
        spin = rotation @ part.tensor @ rotation.T @ w
        total += np.concatenate([linear, spin + np.cross(position + arm, linear)])
    return total


def test_a_load_at_rest_in_the_world_brings_no_momentum():
    simulation = moving()
    boxes = [box.inertia() for box in scenario("ring6").payload.boxes]
    before, place = momentum(simulation, boxes), simulation.data.qpos.copy()
    simulation.inject(3.0, (-0.3, 0.2, 0.08), (0.2, 0.1, 0.3))
    load = Inertia.of_box(3.0, (0.2, 0.1, 0.3), Pose(np.eye(3), np.array([-0.3, 0.2, 0.08])))
    np.testing.assert_allclose(momentum(simulation, [*boxes, load]), before, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(simulation.data.qpos, place)


def test_the_engine_keeps_its_generalised_momentum():
    simulation = moving()
    model, data = simulation.model, simulation.data

    def generalised() -> Array:
        mujoco.mj_forward(model, data)
        matrix = np.empty((6, 6))
        mujoco.mj_fullM(model, data, matrix)
        momentum: Array = matrix @ data.qvel
        return momentum

    before = generalised()
    simulation.inject(3.0, (-0.3, 0.2, 0.08))
    np.testing.assert_allclose(generalised(), before, rtol=1e-12, atol=1e-13)


def test_a_load_that_leaves_takes_its_momentum_along():
    simulation = moving()
    load = simulation.inject(3.0, (-0.3, 0.2, 0.08))
    twist = simulation.data.qvel.copy()
    assert simulation.remove(load.id) == load
    np.testing.assert_array_equal(simulation.data.qvel, twist)
    assert simulation.loads.states == []


def test_a_slot_that_was_emptied_is_as_if_never_used():
    used, fresh = Simulation(scenario()), Simulation(scenario())
    used.remove(used.inject(5.0, (0.4, 0.4, 0.4)).id)
    references = excitation(scenario())
    for block in range(10):
        result, expected = used.advance(references(block)), fresh.advance(references(block))
        for name, measured in result.measurements.items():
            np.testing.assert_array_equal(measured.samples, expected.measurements[name].samples)


def test_a_leak_leaves_a_payload_for_each_block_whose_newton_euler_equations_hold():
    leaking = LoadChange(at=0.1, mass=2.0, position=(-0.2, 0.1, 0.3), size=(0.2, 0.1, 0.3), leak=4.0)
    chosen = scenario("ring6", load_changes=(leaking,))
    simulation, references = Simulation(chosen), excitation(chosen, feed_forward=True)
    scene = simulation.scene
    payload_in_r1 = Pose(scene.rotations[0], scene.translations[0]).inverse()
    rest = scenario("ring6").payload.inertia()
    for block in range(140):
        (result,) = run(simulation, references, 1)
        left = 0.0 if block < 20 else max(0.0, 2.0 - 4.0 * 0.005 * (block - 20))
        load = Inertia.of_box(left, leaking.size, Pose(np.eye(3), np.array(leaking.position)))
        expected = combined([rest, load])
        truth = result.truth.payload
        assert truth.mass == pytest.approx(expected.mass, rel=1e-12)
        np.testing.assert_allclose(truth.com, expected.com, rtol=1e-12, atol=1e-15)
        np.testing.assert_allclose(truth.tensor, expected.tensor, rtol=1e-11, atol=1e-14)
        # The last sample is the last step, to which the engine's acceleration belongs.
        last, alpha = result.measurements["r1"].samples[-1], payload_in_r1.rotation @ simulation.data.qacc[3:]
        needed = Inertia(truth.mass, truth.com, truth.tensor).transported(payload_in_r1)
        np.testing.assert_allclose(
            payload_in_r1.adjoint() @ result.truth.total_wrench,
            needed.wrench(last[GYRO], last[ACCELERATION], alpha),
            rtol=1e-9,
            atol=1e-10,
        )
    assert truth.mass == pytest.approx(rest.mass, rel=1e-12)
    assert [load.mass for load in result.truth.loads] == [0.0]


def test_a_load_that_has_leaked_away_is_as_if_taken_away():
    leaked, taken = moving(), moving()
    leaked.inject(3.0, (-0.3, 0.2, 0.08), leak=1e3)
    load = taken.inject(3.0, (-0.3, 0.2, 0.08))
    references = excitation(scenario("ring6"))
    for step in range(10):
        result, expected = (simulation.advance(references(simulation.block)) for simulation in (leaked, taken))
        for name, measured in result.measurements.items():
            np.testing.assert_array_equal(measured.samples, expected.measurements[name].samples)
        if step == 0:
            taken.remove(load.id)
    assert leaked.remove(load.id).mass == 0.0


def test_loads_are_numbered_as_they_come_and_slots_used_again():
    simulation = Simulation(scenario())
    assert simulation.loads.slots_free == 4
    assert [simulation.inject(1.0, (0.0, 0.0, 0.1)).id for _ in range(4)] == [1, 2, 3, 4]
    simulation.remove(2)
    assert simulation.loads.slots_free == 1
    assert simulation.inject(2.5, (0.1, 0.0, 0.1), (0.2, 0.2, 0.2)).id == 5
    assert [load.id for load in simulation.loads.states] == [1, 3, 4, 5]
    assert simulation.advance({}).truth.loads == simulation.loads.states
    assert simulation.advance({}).truth.payload.mass == pytest.approx(5.0 + 3 * 1.0 + 2.5)


def test_loads_can_be_seen_only_while_they_are_there():
    simulation = Simulation(scenario())

    def visible() -> int:
        return int((simulation.model.geom_rgba[:, 3] > 0.0).sum())

    without = visible()
    load = simulation.inject(1.0, (0.1, 0.2, 0.3), (0.2, 0.4, 0.6))
    assert visible() == without + 1
    geom = simulation.model.geom("slot0")
    np.testing.assert_allclose(geom.size, [0.1, 0.2, 0.3])
    simulation.remove(load.id)
    assert visible() == without


@pytest.mark.parametrize(
    ("mass", "position", "size", "message"),
    [
        (-1.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), r"mass of a load is -1.0 kg but expected"),
        (0.0, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), r"mass of a load is 0.0 kg"),
        (math.nan, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), r"mass of a load is nan kg"),
        (math.inf, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1), r"mass of a load is inf kg"),
        (1.0, (0.0, math.nan, 0.0), (0.1, 0.1, 0.1), r"position of a load is \(0.0, nan, 0.0\) m"),
        (1.0, (0.0, 0.0), (0.1, 0.1, 0.1), r"position of a load is \(0.0, 0.0\) m but expected three"),
        (1.0, (0.0, 0.0, 0.0), (0.1, 0.0, 0.1), r"size of a load is \(0.1, 0.0, 0.1\) m"),
        (
            1.0,
            (400.0, 0.0, 0.0),
            (0.1, 0.1, 0.1),
            r"\(400.0, 0.0, 0.0\) m, which is 400 m outside the payload, which",
        ),
        (1.0, (1e300, 0.0, 0.0), (0.1, 0.1, 0.1), r"inf m outside .* positions are in metres, in the payload's frame"),
        (1.0, (0.0, 0.0, 0.0), (0.1, 100.0, 0.1), r"\(0.1, 100.0, 0.1\) m, which is 100 m long; .* are in metres"),
        (1.7e308, (0.8, 0.8, 0.0), (0.1, 0.1, 0.1), r"inertia of a load .* overflows"),
    ],
)
def test_impossible_loads_are_refused_and_change_nothing(mass, position, size, message):
    simulation = moving()
    twist = simulation.data.qvel.copy()
    with pytest.raises(LoadError, match=message):
        simulation.inject(mass, position, size)
    assert simulation.loads.states == []
    np.testing.assert_array_equal(simulation.data.qvel, twist)
    assert simulation.inject(1.0, (0.0, 0.0, 0.0)).id == 1


@pytest.mark.parametrize("name", ["ring3", "crate4"])
def test_loads_may_lie_where_the_scenario_itself_may_put_them(name):
    """On boxes, and on what is known by its mass properties only; the same for how large they may be."""
    chosen = scenario(name, load_changes=())
    simulation = Simulation(chosen)

    def by_scenario(place: Vector, size: Vector) -> None:
        change = LoadChange(at=1.0, mass=1.0, position=place, size=size)
        check(msgspec.structs.replace(chosen, load_changes=(change,)), "x", load_place_complaints)

    def by_request(place: Vector, size: Vector) -> None:
        simulation.remove(simulation.inject(1.0, place, size).id)

    lengths = np.geomspace(0.5, 50.0, 40).tolist()
    far = [((-x, 0.2, 0.1), (0.1, 0.1, 0.1)) for x in lengths]
    large = [((0.0, 0.2, 0.1), (0.1, x, 0.1)) for x in lengths]
    for boxes, end in ((far, "positions are in metres, in the payload's frame"), (large, "sizes are in metres")):
        complaints = [complaint(by_request, *box) for box in boxes]
        assert complaints == [complaint(by_scenario, *box) for box in boxes]
        assert (complaints[0], complaints[-1].rpartition(": ")[2]) == ("", end)


def complaint(put: Callable[[Vector, Vector], None], place: Vector, size: Vector) -> str:
    """What is wrong with a load; empty if nothing is."""
    try:
        put(place, size)
    except (LoadError, ScenarioError) as error:
        return str(error).partition(" which is ")[2]
    return ""


@pytest.mark.parametrize("name", ["ring3", "arms4"])
def test_the_engine_knows_what_hangs_on_what(name):
    """Of each body: its mass, and that of all that move with it."""
    simulation = Simulation(scenario(name))
    load = simulation.inject(2.0, (0.1, 0.0, 0.1))
    simulation.inject(1.0, (0.0, 0.1, 0.1))
    simulation.remove(load.id)
    model = simulation.model
    expected = model.body_mass.copy()
    for body in range(model.nbody - 1, 0, -1):
        expected[model.body_parentid[body]] += expected[body]
    np.testing.assert_allclose(model.body_subtreemass, expected)


@pytest.mark.parametrize("leak", [-0.1, math.nan, math.inf])
def test_impossible_leaks_are_refused(leak):
    simulation = Simulation(scenario())
    with pytest.raises(LoadError, match=rf"leak of a load is {leak} kg/s but expected"):
        simulation.inject(1.0, (0.0, 0.0, 0.0), leak=leak)
    assert simulation.loads.states == []


def test_too_many_loads_and_unknown_loads_are_refused():
    simulation = Simulation(scenario())
    with pytest.raises(LoadError, match=r"no load 1: there are no loads"):
        simulation.remove(1)
    for _ in range(4):
        simulation.inject(1.0, (0.0, 0.0, 0.1))
    with pytest.raises(LoadError, match=r"all 4 load slots .* remove one of the loads 1, 2, 3, 4, or"):
        simulation.inject(1.0, (0.0, 0.0, 0.1))
    with pytest.raises(LoadError, match=r"no load 7: the loads are 1, 2, 3, 4"):
        simulation.remove(7)
    assert len(simulation.advance({}).truth.loads) == 4


@pytest.mark.parametrize(("at", "block"), [(0.0, 0), (0.02, 1), (0.051, 3), (0.06, 3)])
def test_scenarios_change_loads_at_the_first_border_not_before_their_time(at, block):
    chosen = scenario(block=20, load_changes=(LoadChange(at=at, mass=2.0), LoadChange(at=at + 0.04, remove=1)))
    masses = [result.truth.payload.mass for result in run(Simulation(chosen), excitation(chosen), 8)]
    expected = [7.0 if block <= k < block + 2 else 5.0 for k in range(8)]
    np.testing.assert_allclose(masses, expected)


def test_a_change_that_found_no_slot_is_told_and_the_run_goes_on():
    chosen = scenario(block=20, load_changes=(LoadChange(at=0.02, mass=2.0),))
    simulation = Simulation(chosen)
    for _ in range(4):
        simulation.inject(1.0, (0.0, 0.0, 0.1))
    problems = [result.problems for result in run(simulation, excitation(chosen), 3)]
    assert [len(told) for told in problems] == [0, 1, 0]
    assert "the load change at 0.02 s was skipped: all 4 load slots" in problems[1][0]
    assert len(simulation.loads.states) == 4


def test_scenarios_whose_changes_cannot_be_made_are_refused():
    five = tuple(LoadChange(at=float(at), mass=1.0) for at in range(5))
    with pytest.raises(ScenarioError, match=r"5 loads at a time from 4.0 s on, but 'payload.load_slots' is 4"):
        Simulation(scenario(load_changes=five))
    with pytest.raises(ScenarioError, match=r"remove': found 2 at 3.0 s, expected one of the loads .*\[1\]"):
        Simulation(scenario(load_changes=(*five[:1], LoadChange(at=3.0, remove=2))))
    payload = msgspec.structs.replace(scenario().payload, load_slots=0)
    simulation = Simulation(scenario(payload=payload))
    with pytest.raises(LoadError, match=r"all 0 load slots"):
        simulation.inject(1.0, (0.0, 0.0, 0.0))


def test_a_payload_that_the_robots_lose_ends_the_run():
    simulation = Simulation(scenario())
    motion = np.zeros((5, 12))
    motion[:, 3] = 100.0
    asked = {name: reference(name, 0, motion) for name in simulation.scene.robots}
    words = r"at 0\.\d+ s the robots have lost the payload: it is .* m from its home"
    with pytest.raises(SimulationError, match=words):
        run(simulation, lambda _: asked, 100)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e200])
def test_references_that_the_engine_would_ignore_end_the_run(bad):
    simulation = Simulation(scenario())
    simulation.advance({})
    motion = np.zeros((5, 12))
    motion[3, 5] = bad
    with pytest.raises(SimulationError, match=r"at 0.005 s references of r2 contain numbers"):
        simulation.advance({"r1": reference("r1", 1, np.zeros((5, 12))), "r2": reference("r2", 1, motion)})


@pytest.mark.parametrize(("stiffness", "damping"), [((800.0, 0.0), (70.0, 0.0)), ((800.0, 30.0), (0.0, 0.0))])
@pytest.mark.parametrize("column", [6, 8])
def test_rates_have_a_limit_even_where_no_damping_acts_on_them(column, stiffness, damping):
    """Gimbals, and springs without damping: until the next sample the hand goes on at its rate."""
    chosen = scenario(rate=100)
    robots = msgspec.structs.replace(chosen.robots, stiffness=stiffness, damping=damping)
    simulation, reach = Simulation(msgspec.structs.replace(chosen, robots=robots)), Reach(robots)
    motion = np.zeros((5, 12))
    motion[:, column] = 2e12
    assert "motion asks for" in str(reach.excess(reference("r1", 0, motion)))
    motion[:, column] = 600.0
    asked = reference("r1", 0, motion)
    assert reach.excess(asked) is None
    run(simulation, lambda _: {"r1": asked}, 120)


@pytest.mark.parametrize("column", [0, 2, 5, 6, 8, 11, "force", "torque"])
def test_one_robot_that_asks_for_all_that_an_arm_can_do_does_not_end_the_run(column):
    simulation, reach = Simulation(scenario()), Reach(scenario().robots)

    def asked(size: float) -> Reference:
        motion, wrench = np.zeros((5, 12)), np.zeros(6)
        if isinstance(column, int):
            motion[:, column] = size
        else:
            wrench[["force", "torque"].index(column) * 3] = size
        return reference("r1", 0, motion, wrench)

    most = 1e5
    while reach.excess(asked(most)) is not None:
        most *= 0.99
    assert most > 1.0
    run(simulation, lambda _: {"r1": asked(most)}, 600)
