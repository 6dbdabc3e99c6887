"""Grasps that slip: from then on a robot holds the payload elsewhere, and feels and reads what there is there."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.app.results.judge import Judge
from coheft.errors import ScenarioError
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.measurement import GYRO, VELOCITY
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.change_checks import slip_complaints
from coheft.wire.scenario.rules import check
from coheft.wire.scenario.schema import Slip
from tests.physics_run import excitation, run, scenario

SLIP = Slip(at=0.1, robot="r2", translation=(0.01, 0.0, -0.02), rotation_deg=(0.0, 2.0, 1.0))
EXACT = 1e-9


def test_after_a_slip_readings_are_those_of_a_body_held_elsewhere() -> None:
    exact = scenario(slips=(SLIP,))
    simulation = Simulation(exact)
    results = run(simulation, excitation(exact, feed_forward=True), 60)
    judge = Judge(simulation.scene, [result.truth for result in results])
    before, after = (judge.relative_pose("r1", "r2", block) for block in (19, 20))
    moved = before.inverse() @ after
    np.testing.assert_allclose(moved.translation, SLIP.translation, atol=1e-12)
    np.testing.assert_allclose(moved.rotation, SLIP.pose().rotation, atol=1e-12)
    for block in (10, 19, 20, 21, 50):
        pose = judge.relative_pose("r1", "r2", block)
        one, other = (results[block].measurements[name].samples[-1] for name in ("r1", "r2"))
        np.testing.assert_allclose(one[GYRO], pose.rotation @ other[GYRO], atol=EXACT)
        velocity = pose.rotation @ other[VELOCITY] + np.cross(pose.translation, one[GYRO])
        np.testing.assert_allclose(one[VELOCITY], velocity, atol=EXACT)


def test_newton_and_euler_hold_with_the_wrench_where_it_is_applied_now() -> None:
    exact = scenario(slips=(SLIP,))
    simulation = Simulation(exact)
    results = run(simulation, excitation(exact, feed_forward=True), 60)
    truth = results[-1].truth
    to_payload = Pose(simulation.scene.rotations[0], simulation.scene.translations[0])
    last = results[-1].measurements["r1"].samples[-1]
    payload = Inertia(truth.payload.mass, truth.payload.com, truth.payload.tensor).transported(to_payload.inverse())
    alpha = to_payload.rotation.T @ simulation.data.qacc[3:]
    needed = payload.wrench(last[:3], last[6:9], alpha)
    np.testing.assert_allclose(to_payload.inverse().adjoint() @ truth.total_wrench, needed, atol=1e-9)


def test_a_sensor_beside_the_grasp_moves_along() -> None:
    shipped = scenario(slips=(SLIP,))
    simulation = Simulation(shipped)
    grasps = simulation._grasps
    before = np.linalg.norm(simulation.model.site("r2").pos)
    run(simulation, excitation(shipped), 25)
    assert np.linalg.norm(simulation.model.site("r2").pos) != before
    np.testing.assert_allclose(simulation.model.site("r2").pos, grasps.poses[1].translation, atol=1e-12)


@pytest.mark.parametrize(
    ("slip", "message"),
    [
        (Slip(at=1.0, robot="r9", translation=(0.01, 0.0, 0.0)), r"'slips\[0\].robot': found 'r9', expected one of"),
        (Slip(at=1.0, robot="r1"), r"'slips\[0\]': found neither 'translation' nor 'rotation_deg'"),
    ],
)
def test_slips_that_cannot_be_are_refused(slip: Slip, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        check(scenario(slips=(slip,)), "mine.toml", slip_complaints)


def test_hands_with_joints_cannot_slip() -> None:
    arms = scenario("arms4", slips=(SLIP,))
    with pytest.raises(ScenarioError, match="expected 'springs'"):
        check(arms, "mine.toml", slip_complaints)
