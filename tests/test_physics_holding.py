"""Robots that let go of the payload and take hold again."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.errors import SimulationError
from coheft.estimation.measurement import ACCELERATION, GYRO, TWIST, WRENCH
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.scene import PAYLOAD_HOME
from coheft.physics_server.simulation import Simulation
from tests.physics_run import excitation, run, samples, scenario

EXACT = 1e-12


def test_one_that_let_go_exerts_nothing_and_reads_an_arm_at_rest():
    exact = scenario("ring6")
    simulation = Simulation(exact)
    run(simulation, excitation(exact, feed_forward=True), 10)
    simulation.release("r2")
    read = samples(run(simulation, excitation(exact, feed_forward=True), 40))[1]
    np.testing.assert_array_equal(read[:, TWIST], 0.0)
    np.testing.assert_array_equal(read[:, WRENCH], 0.0)
    home = PAYLOAD_HOME @ exact.robots.poses()[1]
    upwards = np.tile([0.0, 0.0, 9.81], (len(read), 1))
    np.testing.assert_allclose(read[:, ACCELERATION] @ home.rotation.T, upwards, atol=1e-12)


def test_the_others_carry_it_and_newton_euler_holds_for_their_wrenches_alone():
    exact = scenario("ring6")
    simulation = Simulation(exact)
    simulation.release("r2")
    references = excitation(exact)
    weighed = []
    for _ in range(60):
        (result,) = run(simulation, references, 1)
        last = np.array([measured.samples[-1] for measured in result.measurements.values()])
        payload = Inertia(result.truth.payload.mass, result.truth.payload.com, result.truth.payload.tensor)
        to_payload = exact.robots.poses()[0]
        alpha = to_payload.rotation.T @ simulation.data.qacc[3:]
        needed = payload.transported(to_payload.inverse()).wrench(last[0, GYRO], last[0, ACCELERATION], alpha)
        total = to_payload.inverse().adjoint() @ result.truth.total_wrench
        assert np.linalg.norm(needed - total) < EXACT * np.linalg.norm(total)
        weighed.append(result.truth.total_wrench)
    assert np.ptp(weighed, axis=0).min() > 0.1


def test_who_takes_hold_again_reads_the_payload_again():
    exact = scenario("ring6")
    held, released = Simulation(exact), Simulation(exact)
    released.release("r2")
    released.grasp("r2")
    references = excitation(exact)
    np.testing.assert_array_equal(samples(run(held, references, 20)), samples(run(released, references, 20)))


def test_unknown_robots_cannot_let_go():
    simulation = Simulation(scenario("ring3"))
    with pytest.raises(SimulationError, match="no robot r9: the robots are r1, r2, r3"):
        simulation.release("r9")
