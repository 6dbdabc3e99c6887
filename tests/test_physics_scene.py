"""Where the robots hold the payload."""

from __future__ import annotations

from pathlib import Path

import msgspec
import mujoco
import numpy as np
import pytest

from coheft.estimation.geometry.spatial import Pose
from coheft.physics_server.scene import PAYLOAD_HOME, home_name
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.file import available_scenarios, load_scenario, parse_scenario
from coheft.wire.scenario.schema import Perimeter
from tests.physics_run import scenario


@pytest.mark.parametrize("name", available_scenarios())
def test_shipped_scenarios_place_every_grasp_on_the_payload(name):
    shipped = load_scenario(name)
    grasps = shipped.robots.poses()
    assert len(grasps) == shipped.robot_count
    plates = sorted(shipped.payload.boxes, key=lambda box: box.mass)[-1:]  # mere mass properties have no shape
    for grasp in grasps:
        np.testing.assert_allclose(grasp.rotation @ grasp.rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(grasp.rotation) > 0.0
        for plate in plates:
            reach = np.abs(grasp.translation[:2]) / (np.array(plate.size[:2]) / 2.0)
            assert reach.max() == pytest.approx(1.0)


def test_perimeter_spreads_grasps_evenly_along_the_rim():
    perimeter = Perimeter(count=24, extent=(2.0, 1.4), height=0.05, seed=3)
    robots = msgspec.structs.replace(scenario().robots, perimeter=perimeter)
    grasps = scenario(robots=robots).robots.poses()
    points = np.array([grasp.translation for grasp in grasps])
    corner = np.array([-1.0, -0.7])
    # Distance along the rim from its corner, counter-clockwise: the two lower edges, then the two upper ones.
    forth = (points[:, :2] - corner).sum(axis=1)
    is_lower = np.isclose(points[:, 1], -0.7) | np.isclose(points[:, 0], 1.0)
    along = np.where(is_lower, forth, 6.8 - forth)
    np.testing.assert_allclose(np.diff(along), 6.8 / 24)
    assert np.abs(points[:, 2]).max() <= 0.05
    assert len(np.unique(points[:, 2])) == 24


def test_perimeter_draws_orientations_and_heights_from_its_seed():
    def placed(seed: int) -> np.ndarray:
        robots = msgspec.structs.replace(scenario().robots, perimeter=Perimeter(count=6, extent=(1.0, 0.7), seed=seed))
        return np.array(
            [[*grasp.rotation.ravel(), grasp.translation[2]] for grasp in scenario(robots=robots).robots.poses()]
        )

    np.testing.assert_array_equal(placed(1), placed(1))
    assert (placed(1) != placed(2)).all()


def test_orientations_are_spread_over_all_rotations():
    """The mean of uniformly distributed rotation matrices is zero; each entry's variance is a third."""
    count = 3000
    robots = msgspec.structs.replace(scenario().robots, perimeter=Perimeter(count=count, extent=(1.0, 0.7)))
    rotations = np.array([grasp.rotation for grasp in scenario(robots=robots).robots.poses()])
    assert np.abs(rotations.mean(axis=0)).max() < 5.0 * np.sqrt(1 / 3 / count)


def test_listed_grasps_are_taken_as_they_are():
    line = load_scenario("line4")
    for grasp, listed in zip(line.robots.poses(), line.robots.grasps, strict=True):
        np.testing.assert_array_equal(grasp.translation, listed.position)
        np.testing.assert_array_equal(grasp.rotation, listed.pose().rotation)


def test_scene_tells_where_the_engines_sites_are():
    chosen = scenario("ring6")
    simulation = Simulation(chosen, {"r1": ("r2", "r6")})
    scene, data = simulation.scene, simulation.data
    assert scene.robots == list(chosen.robot_names)
    assert scene.neighbours == {"r1": ["r2", "r6"]}
    simulation.advance({})
    payload = data.body("payload")
    payload_pose = Pose(payload.xmat.reshape(3, 3), payload.xpos)
    for name, rotation, translation in zip(scene.robots, scene.rotations, scene.translations, strict=True):
        grasp = Pose(rotation, translation)
        for site, expected in ((name, payload_pose @ grasp), (home_name(name), PAYLOAD_HOME @ grasp)):
            np.testing.assert_allclose(data.site(site).xmat.reshape(3, 3), expected.rotation, atol=1e-12)
            np.testing.assert_allclose(data.site(site).xpos, expected.translation, atol=1e-12)


def test_what_mujoco_warns_of_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    simulation = Simulation(scenario())
    simulation.data.qvel[:] = np.inf
    mujoco.mj_step(simulation.model, simulation.data)
    assert "MuJoCo warns: " in caplog.text
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("moments", [(0.02, 0.04, 0.06), (0.1, 0.1, 0.2), (0.01, 0.07, 0.08)], ids=str)
@pytest.mark.parametrize("mass", [0.1, 6.5, 50.0, 500.0, 1000.0])
def test_a_plane_payload_of_any_mass_is_simulated(mass: float, moments: tuple[float, float, float]) -> None:
    """Its largest moment of inertia equals the sum of the others, but for rounding."""
    plane = parse_scenario(
        f"""
        name = "plane"
        payload.properties = {{ mass = {mass}, com = [0.1, 0, 0], principal = {[mass * each for each in moments]} }}
        robots.stiffness = {[100.0 * mass, 4.0 * mass]}
        robots.damping = {[4.0 * mass, 0.16 * mass]}
        robots.grasps = [{{ position = [0, 0, 0] }}, {{ position = [0.3, 0, 0] }}]
        """,
        "plane.toml",
    )
    simulation = Simulation(plane)
    simulation.advance({})
    np.testing.assert_allclose(simulation.model.body("payload").inertia, np.multiply(mass, moments))
