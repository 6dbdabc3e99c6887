"""Seven-joint arms: rigid welds, wrist sensors that tell the truth, hands that behave as springs do."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.errors import ScenarioError, SimulationError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import GYRO, SAMPLE_SIZE
from coheft.estimation.moments.body import FORCING, MOTION_SIZE, load_operator, residual_covariance
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import RowNoise, row_of_samples
from coheft.estimation.moments.unknowns import State
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.arms.model import hand_name
from coheft.physics_server.scene import home_name
from coheft.physics_server.simulation import Simulation
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.checks import check_scenario
from coheft.wire.scenario.file import load_scenario
from tests.physics_run import excitation, reference, run, samples, scenario

ARMS = scenario("arms4")
LENGTH = 10
"""Samples of a row."""


def test_sensors_at_the_wrists_read_one_rigid_body_and_all_that_moves_it() -> None:
    """Errors that last are averaged away by no one, so they must be far below the noise."""
    simulation = Simulation(ARMS)
    results = run(simulation, excitation(ARMS), 100)
    before = samples(results)[:, 200:]  # the start is a kick
    assert np.abs(before[..., GYRO]).max() > 0.2
    assert disagreement(before, results[-1].truth) < 0.005
    simulation.inject(3.0, (-0.3, 0.2, 0.08))
    results = run(simulation, excitation(ARMS), 50)
    assert disagreement(samples(results), results[-1].truth) < 0.005


def disagreement(measured: Array, truth: Truth) -> float:
    """Root mean square over time of what differs most between samples (N, n, 15) and a rigid body, in sigmas."""
    grasps, sensors = ARMS.robots.poses(), ARMS.sensors
    noise = RowNoise.of_samples(sensors.noise, LENGTH, sensors.rate)
    settings = FitSettings(noise, LENGTH / sensors.rate)
    blocks = measured.swapaxes(0, 1).reshape(-1, LENGTH, len(grasps), SAMPLE_SIZE)
    rows = np.array([[row_of_samples(own, 0.0, sensors.rate) for own in block.swapaxes(0, 1)] for block in blocks])
    rows = np.hstack([rows.reshape(len(rows), -1), np.ones((len(rows), 1))])
    payload = Inertia(truth.payload.mass, truth.payload.com, truth.payload.tensor)
    load = np.concatenate([np.zeros(6), payload.barycentric()])
    body = settings.body(State.first(grasps, settings.errors).with_load(load))
    of_motion = body.residuals(rows, rows @ body.motion_map[:MOTION_SIZE].T)
    of_wrench = rows @ (body.wrench_map - load_operator(load) @ body.motion_map[FORCING]).T
    errors = of_motion, of_wrench / np.sqrt(np.diag(residual_covariance(body, load)))
    # Rows are less noisy than samples.
    return max(float(np.sqrt(np.square(error).mean(axis=0)).max()) for error in errors) / np.sqrt(LENGTH)


def test_hands_sag_as_springs_do() -> None:
    """At rest the wrench is stiffness times displacement, whatever the joints have to do for that."""
    simulation = Simulation(ARMS)
    for _ in range(400):
        measured = simulation.advance({}).measurements
    k_t = ARMS.robots.stiffness[0]
    for name in ARMS.robot_names:
        hand, home = simulation.data.site(hand_name(name)), simulation.data.site(home_name(name))
        spring = k_t * hand.xmat.reshape(3, 3).T @ (home.xpos - hand.xpos)
        np.testing.assert_allclose(measured[name].samples[-1, 9:12], spring, atol=0.2)


def test_feedforward_adds_to_the_wrench() -> None:
    simulation = Simulation(ARMS)
    before = simulation.data.qpos[2]
    weight = ARMS.payload.inertia().mass * 9.81
    push = np.array([-weight / 4.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # their x axes point down
    still = np.zeros((ARMS.sensors.block, 12))
    run(simulation, lambda block: {name: reference(name, block, still, push) for name in ARMS.robot_names}, 200)
    assert before < 0.98
    assert simulation.data.qpos[2] == pytest.approx(1.0, abs=2e-3)


def test_equal_runs_are_equal_bit_for_bit() -> None:
    one, other = (samples(run(Simulation(ARMS), excitation(ARMS), 20)) for _ in range(2))
    np.testing.assert_array_equal(one, other)


def test_welds_hold_for_good() -> None:
    with pytest.raises(SimulationError, match="hand of r2 is welded to the payload, it cannot release it"):
        Simulation(ARMS).release("r2")


def test_arms_need_stiffness_in_rotation() -> None:
    robots = msgspec.structs.replace(ARMS.robots, stiffness=(800.0, 0.0), damping=(70.0, 0.0))
    with pytest.raises(ScenarioError, match=r"'robots.arms': found 'seven-joint'.*no gimbals"):
        check_scenario(msgspec.structs.replace(load_scenario("arms4"), robots=robots), "x.toml")
