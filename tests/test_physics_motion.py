"""Newton-Euler and rigid-body kinematics on what the simulated robots really measure."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion, rotation_log
from coheft.estimation.measurement import ACCELERATION, GYRO, TWIST, WRENCH
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.scene import PAYLOAD_HOME
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import LoadChange
from tests.physics_run import excitation, reference, run, samples, scenario

EXACT = 1e-12
GRASPS = scenario("ring6").robots.poses()
LOADS = (LoadChange(at=0.1, mass=2.0, position=(-0.2, 0.1, 0.3)), LoadChange(at=0.3, remove=1))


def relative_error(found: Array, expected: Array) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


@pytest.fixture(scope="module")
def moments() -> list[tuple[Array, Array, Inertia]]:
    """At the last sample of each block: samples (N, 15), angular acceleration (3,) in the payload's frame, payload.

    Robots push with feed-forward, and a load comes and goes.
    """
    exact = scenario("ring6", load_changes=LOADS)
    simulation, references = Simulation(exact), excitation(exact, feed_forward=True)
    taken = []
    for _ in range(100):
        (result,) = run(simulation, references, 1)
        # At 1000 samples a second the last sample is the last step, to which the engine's acceleration belongs.
        last = np.array([measured.samples[-1] for measured in result.measurements.values()])
        truth = result.truth
        payload = Inertia(truth.payload.mass, truth.payload.com, truth.payload.tensor)
        taken.append((last, simulation.data.qacc[3:].copy(), payload))
    assert {round(payload.mass, 9) for _, _, payload in taken} == {10.0, 12.0}
    return taken


def test_newton_euler_holds_in_every_grasp_frame(moments):
    for last, alpha, payload in moments:
        for i, payload_in_i in enumerate(grasp.inverse() for grasp in GRASPS):
            total = sum((payload_in_i @ grasp).adjoint() @ row[WRENCH] for grasp, row in zip(GRASPS, last, strict=True))
            alpha_i = payload_in_i.rotation @ alpha
            needed = payload.transported(payload_in_i).wrench(last[i, GYRO], last[i, ACCELERATION], alpha_i)
            assert relative_error(needed[:3], total[:3]) < EXACT
            assert relative_error(needed[3:], total[3:]) < EXACT


def test_twists_and_accelerations_are_those_of_one_rigid_body(moments):
    for last, alpha, _ in moments:
        for i in range(len(GRASPS)):
            j = (i + 1) % len(GRASPS)
            pose_j_in_i = GRASPS[i].inverse() @ GRASPS[j]
            p, w_i = pose_j_in_i.translation, last[i, GYRO]
            alpha_i = GRASPS[i].rotation.T @ alpha
            carried = (
                pose_j_in_i.rotation @ last[j, ACCELERATION] - np.cross(alpha_i, p) - np.cross(w_i, np.cross(w_i, p))
            )
            assert relative_error(pose_j_in_i.adjoint() @ last[j, TWIST], last[i, TWIST]) < EXACT
            assert relative_error(carried, last[i, ACCELERATION]) < EXACT


def test_total_wrench_of_the_truth_is_the_sum_of_what_was_measured():
    noisy = scenario("ring6", noise_scale=1.0)
    for result in run(Simulation(noisy), excitation(noisy), 5):
        last = [measured.samples[-1] for measured in result.measurements.values()]
        total = sum(grasp.adjoint() @ sample[WRENCH] for grasp, sample in zip(GRASPS, last, strict=True))
        np.testing.assert_allclose(result.truth.total_wrench, total, rtol=EXACT, atol=1e-13)
        np.testing.assert_array_equal(result.truth.samples, last)


def test_arms_are_springs_and_dampers_about_their_references_plus_feed_forward():
    exact = scenario("ring6")
    simulation, references = Simulation(exact), excitation(exact, feed_forward=True)
    (k_t, k_r), (d_t, d_r) = exact.robots.stiffness, exact.robots.damping
    for block in range(40):
        asked = references(block)
        result = simulation.advance(asked)
        payload = Pose(rotation_from_quaternion(result.truth.quaternion), result.truth.position)
        for grasp, (name, measured) in zip(GRASPS, result.measurements.items(), strict=True):
            grasp_in_home = (PAYLOAD_HOME @ grasp).inverse() @ payload @ grasp
            w, v = grasp_in_home.rotation @ measured.samples[-1, TWIST].reshape(2, 3, 1)
            turn, place, turn_rate, place_rate = asked[name].motion[-1].reshape(4, 3)
            force = k_t * (place - grasp_in_home.translation) + d_t * (place_rate - v[:, 0])
            torque = k_r * (turn - rotation_log(grasp_in_home.rotation)) + d_r * (turn_rate - w[:, 0])
            spring = np.concatenate([grasp_in_home.rotation.T @ force, grasp_in_home.rotation.T @ torque])
            np.testing.assert_allclose(measured.samples[-1, WRENCH], spring + asked[name].wrench, rtol=1e-9, atol=1e-9)


def test_true_payload_is_the_engines():
    exact = scenario("ring6", load_changes=LOADS)
    simulation, references = Simulation(exact), excitation(exact)
    for _ in range(100):
        (result,) = run(simulation, references, 1)
        truth = result.truth.payload
        spatial = Inertia(truth.mass, truth.com, truth.tensor).spatial()
        engines = np.empty((6, 6))
        mujoco.mj_fullM(simulation.model, simulation.data, engines)
        # The engine's velocity is (v in the world's axes, w in the payload's); bring both to (w, v) of the payload.
        to_world = np.zeros((6, 6))
        to_world[:3, 3:], to_world[3:, :3] = simulation.data.body("payload").xmat.reshape(3, 3), np.eye(3)
        assert relative_error(to_world.T @ engines @ to_world, spatial) < EXACT


def test_run_starts_at_rest_held_by_the_robots():
    exact = scenario("ring6")
    first = Simulation(exact).advance({})
    weight = exact.payload.inertia().mass * 9.81
    for measured in first.measurements.values():
        assert (measured.samples[0, TWIST] == 0.0).all()
        assert np.linalg.norm(measured.samples[0, ACCELERATION]) == pytest.approx(9.81, rel=1e-6)
    assert np.linalg.norm(first.truth.total_wrench[:3]) == pytest.approx(weight, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ring3", "line4", "ring6", "ring12", "ring24", "quiet"])
def test_robots_hold_the_payload_for_a_minute(name):
    shipped = load_scenario(name)
    exact = scenario(name, rate=100, block=20, load_changes=shipped.load_changes)
    truths = [result.truth for result in run(Simulation(exact), excitation(exact), 300)]
    positions = np.array([truth.position for truth in truths]) - PAYLOAD_HOME.translation
    angles = [2.0 * np.arccos(min(1.0, abs(truth.quaternion[0]))) for truth in truths]
    assert max(angles) < 0.5
    assert np.linalg.norm(positions, axis=1).max() < 0.2
    # No drift: on average over half a minute it is as far from home as its weight alone makes it sag.
    sag = truths[-1].payload.mass * 9.81 / (exact.robot_count * exact.robots.stiffness[0])
    np.testing.assert_allclose(positions[150:].mean(axis=0), [0.0, 0.0, -sag], atol=0.01)


def test_missing_reference_holds_the_last_displacement():
    exact = scenario("ring6")
    references = excitation(exact, feed_forward=True)
    simulation, same = Simulation(exact), Simulation(exact)
    run(simulation, references, 10)
    run(same, references, 10)
    last = references(9)["r2"].motion[-1]
    for block in range(10, 20):
        without = {name: asked for name, asked in references(block).items() if name != "r2"}
        held = np.tile(np.concatenate([last[:6], np.zeros(6)]), (exact.sensors.block, 1))
        result, expected = simulation.advance(without), same.advance({**without, "r2": reference("r2", block, held)})
        for name, measured in result.measurements.items():
            np.testing.assert_array_equal(measured.samples, expected.measurements[name].samples)


def test_accelerometers_and_the_slope_of_gyros_agree():
    """No ripple between samples: with two robots the gyros' slope is all that tells of turning about their line."""
    exact = scenario("ring3", rate=500, block=10)
    taken = samples(run(Simulation(exact), excitation(exact), 150))[:, 500:]
    first, second, _ = exact.robots.poses()
    one, two, to_one = taken[0], taken[1], first.inverse() @ second
    w, alpha, p = one[1:-1, :3], (one[2:, :3] - one[:-2, :3]) * (0.5 * exact.sensors.rate), to_one.translation
    expected = one[1:-1, 6:9] + np.cross(alpha, p) + np.cross(w, np.cross(w, p))
    found = two[1:-1, 6:9] @ to_one.rotation.T
    assert np.abs(found - expected).max() < 0.01 * np.linalg.norm(np.cross(alpha, p), axis=1).max()


def test_reference_goes_on_at_its_rate_between_samples():
    coarse, fine = scenario(rate=250, block=5), scenario(rate=1000, block=20)
    slow, fast = Simulation(coarse), Simulation(fine)
    references = excitation(coarse)
    for block in range(20):
        asked = references(block)
        between = {}
        for name, coarse_one in asked.items():
            motion = np.repeat(coarse_one.motion, 4, axis=0)
            slope = np.diff(coarse_one.motion[:, 6:], axis=0) * 250
            slope = np.repeat(np.concatenate([slope, 2.0 * slope[-1:] - slope[-2:-1]]), 4, axis=0)
            since = np.tile(np.arange(4) / 1000, 5)[:, None]
            motion[:, :6] += since * motion[:, 6:] + 0.5 * since**2 * slope
            motion[:, 6:] += since * slope
            between[name] = reference(name, block, motion)
        result, expected = slow.advance(asked), fast.advance(between)
        for name, measured in result.measurements.items():
            np.testing.assert_allclose(measured.samples, expected.measurements[name].samples[::4], rtol=1e-9, atol=1e-9)


def test_payload_does_not_feel_where_blocks_end():
    """What is not known yet at the end of a block shakes a light payload, if it is not foreseen."""
    taken = []
    for block in (4, 20):
        coarse = scenario("ring6", rate=100, block=block)
        taken.append(samples(run(Simulation(coarse), excitation(coarse), 200 // block))[..., ACCELERATION])
    short, long = taken
    assert np.abs(short - long).max() < 0.02  # of 20 m/s²
