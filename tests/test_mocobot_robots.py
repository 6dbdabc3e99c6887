"""Robots with gimbals and encoders: what they feel, what they tell, how they move."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.agents.motion.via_points import ViaPointMotion
from coheft.app.mocobots.record import SPHERE_TIME, circumcentre, sphere_references
from coheft.errors import ScenarioError
from coheft.estimation.batch.wrist_poses import gimbal_angles
from coheft.estimation.geometry.spatial import Array, Pose, rotation_from_quaternion
from coheft.estimation.measurement import ACCELERATION, GYRO, TORQUE, WRENCH
from coheft.physics_server.arms.encoders import Encoders
from coheft.physics_server.scene import PAYLOAD_HOME
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.encoders import EncoderErrors
from coheft.wire.scenario.file import load_scenario, parse_scenario
from coheft.wire.scenario.motion import Motion, ViaPoints
from coheft.wire.scenario.schema import Scenario
from tests.physics_run import reference as reference_of
from tests.physics_run import run, samples, scenario

CONFIGURATIONS = ["mocobot_a", "mocobot_b", "mocobot_c", "mocobot_d"]
PERFECT = EncoderErrors(angle_bits=32, position_step=1e-12, vibration_deg=0.0, vibration_mm=0.0)


def with_encoders(errors: EncoderErrors, **keys: object) -> Scenario:
    exact = scenario("mocobot_a", rate=1000, **keys)
    return msgspec.structs.replace(exact, sensors=msgspec.structs.replace(exact.sensors, encoders=errors))


def moving(exact: Scenario, blocks: int) -> tuple[Simulation, list]:  # type: ignore[type-arg]
    motion = exact.motion.via_points
    assert motion is not None
    own = {
        name: ViaPointMotion(exact.motion, motion, k, exact.sensors.rate, exact.sensors.block)
        for k, name in enumerate(exact.robot_names)
    }
    simulation = Simulation(exact)
    references = lambda block: {name: reference_of(name, block, own[name].reference(block)) for name in own}  # noqa: E731
    return simulation, run(simulation, references, blocks)


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_gimbals_push_without_torque_and_newton_euler_holds(name: str) -> None:
    exact = scenario(name)
    simulation, results = moving(exact, 60)
    read = samples(results)
    assert not read[..., TORQUE].any()
    # At 1000 samples a second the last sample is the last step, to which the engine's acceleration belongs.
    last, alpha = read[:, -1], simulation.data.qacc[3:]
    grasps = exact.robots.poses()
    total = np.sum([grasp.adjoint() @ row[WRENCH] for grasp, row in zip(grasps, last, strict=True)], axis=0)
    # The first grasp frame is the payload's.
    needed = exact.payload.inertia().wrench(last[0, GYRO], last[0, ACCELERATION], alpha)
    np.testing.assert_allclose(needed, total, atol=1e-9)
    assert np.linalg.norm(alpha) > 0.01


@pytest.mark.parametrize("name", CONFIGURATIONS)
def test_the_papers_grasps_close_their_loop_and_its_payloads_exist(name: str) -> None:
    found = load_scenario(name)
    grasps = found.robots.poses()
    assert found.robot_count == 3
    # Table I gives T_31 as well, to a millimetre.
    third_to_first = {"a": (0.305, 1.105), "b": (0.242, 0.835), "c": (1.132, 0.162), "d": (0.533, 0.571)}
    back = (grasps[2].inverse() @ grasps[0]).translation
    np.testing.assert_allclose(np.abs(back[:2]), third_to_first[name[-1]], atol=2e-3)
    assert np.linalg.eigvalsh(found.payload.inertia().pseudo_inertia())[0] > 0.0


def test_perfect_encoders_tell_the_pose_in_the_home_frame() -> None:
    exact = with_encoders(PERFECT)
    simulation, results = moving(exact, 200)
    told, truth = results[-1].wrists, results[-1].truth
    assert told is not None
    payload = Pose(rotation_from_quaternion(truth.quaternion), truth.position)
    for k, grasp in enumerate(exact.robots.poses()):
        expected = (PAYLOAD_HOME @ grasp).inverse() @ payload @ grasp
        np.testing.assert_allclose(told[-1, k, :3], expected.translation, atol=1e-9)
        np.testing.assert_allclose(Rotation.from_quat(told[-1, k, 3:7]).as_matrix(), expected.rotation, atol=1e-8)
    forces = samples(results)[:, -exact.sensors.block :, WRENCH][..., :3]
    np.testing.assert_allclose(told[..., 7:10].swapaxes(0, 1), forces, atol=1e-6)
    assert simulation.block == 200


GIMBALS = "stiffness = [800.0, 0.0]\ndamping = [70.0, 0.0]"
LEVEL = "grasps = [{ position = [-0.2, 0, 0] }, { position = [0.2, 0, 0], rotation_deg = [0, 0, 120] }]"


@pytest.mark.parametrize(
    ("robots", "more", "message"),
    [
        (LEVEL, "", r"with 'robots.stiffness' = \[\d+.0, 30.0\], expected no stiffness in rotation"),
        (f"arms = 'seven-joint'\n{LEVEL}", "", r"with 'robots.stiffness' = .* expected no stiffness in rotation"),
        (LEVEL, "[carry]", r"with 'robots.stiffness' = .* expected no stiffness in rotation"),
        (
            f"{GIMBALS}\n{LEVEL.replace('[0, 0, 120]', '[0, 5, 0]')}",
            "",
            r"with a grasp of r2 that is tilted by 5°, expected 'robots.grasps' turned about the vertical only",
        ),
        (f"{GIMBALS}\nperimeter = {{ count = 3, extent = [0.4, 0.3] }}", "", "with a grasp of r1 that is tilted by"),
    ],
)
def test_encoders_are_refused_where_recordings_would_be_wrong(robots: str, more: str, message: str) -> None:
    payload = "[payload]\nboxes = [{ mass = 2.0, size = [0.4, 0.3, 0.1] }]"
    text = f'name = "x"\n{payload}\n[sensors.encoders]\n[robots]\n'
    with pytest.raises(ScenarioError, match=f"x.toml: key 'sensors.encoders': found {message}"):
        parse_scenario(f"{text}{robots}\n{more}", "x.toml")
    assert parse_scenario(f"{text}{GIMBALS}\n{LEVEL}", "x.toml").sensors.encoders == EncoderErrors()


def still(count: int, robots: int = 3) -> tuple[Array, Array, Array]:
    """Positions, rotations and forces."""
    return (
        np.full((count, robots, 3), 0.1),
        np.tile(np.eye(3), (count, robots, 1, 1)),
        np.full((count, robots, 3), 20.0),
    )


def told_at_rest(encoders: Encoders, count: int) -> tuple[Array, Array, Array]:
    """Positions, rotations and forces that encoders tell, as of ``still``."""
    told = encoders.measure(*still(count))
    rotations = Rotation.from_quat(told[..., 3:7].reshape(-1, 4)).as_matrix().reshape(*told.shape[:2], 3, 3)
    return told[..., :3], rotations, (rotations @ told[..., 7:10, None])[..., 0]


def test_encoder_noise_is_of_the_size_that_was_asked_for() -> None:
    base = load_scenario("mocobot_a")
    positions, rotations, forces = told_at_rest(Encoders(EncoderErrors(angle_bits=13), base), 20000)
    angles = np.degrees(gimbal_angles(rotations))
    step = 360.0 / 2**13
    np.testing.assert_allclose(angles / step, np.round(angles / step), atol=1e-6)
    assert angles.std() == pytest.approx(np.hypot(0.035, step / np.sqrt(12.0)), rel=0.02)
    assert positions.std() == pytest.approx(np.hypot(0.5e-3, 1e-4 / np.sqrt(12.0)), rel=0.02)
    assert forces.std() == pytest.approx(0.6, rel=0.02)


def test_calibration_errors_are_the_robots_own_and_stay() -> None:
    bounds = EncoderErrors(
        vibration_deg=0.0,
        vibration_mm=0.0,
        misalignment_deg=1.0,
        angle_scale=0.01,
        position_scale=0.03,
        force_scale=0.01,
        force_offset=0.5,
        calibration_seed=4,
    )
    one, other = load_scenario("mocobot_a"), msgspec.structs.replace(load_scenario("mocobot_d"), seed=99)
    first, second = (Encoders(bounds, base) for base in (one, other))
    for name in ("zero", "angle_scale", "position_scale", "force_scale", "force_offset"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        values = getattr(first, name)
        assert len(np.unique(values)) == values.size
    assert np.degrees(np.linalg.norm(first.zero, axis=1)).max() <= 1.0
    assert np.abs(first.position_scale - 1.0).max() <= 0.03
    positions, _, forces = told_at_rest(first, 2000)
    np.testing.assert_allclose(positions[0, :, 0], 0.1 * first.position_scale[:, 0], atol=6e-5)
    np.testing.assert_allclose(
        forces.mean(axis=0), first.force_scale * 20.0 + first.force_offset, atol=5.0 * 0.6 / np.sqrt(2000.0)
    )


def test_encoders_do_not_change_what_agents_get() -> None:
    with_them, without = scenario("mocobot_b", noise_scale=1.0), scenario("mocobot_b", noise_scale=1.0)
    without = msgspec.structs.replace(without, sensors=msgspec.structs.replace(without.sensors, encoders=None))
    read = [samples(run(Simulation(one), lambda _: {}, 5)) for one in (with_them, without)]
    np.testing.assert_array_equal(*read)


def whole_motion(motion: ViaPointMotion, blocks: int) -> Array:
    return np.concatenate([motion.reference(block) for block in range(blocks)])


def test_rates_of_via_points_are_derivatives() -> None:
    motion = Motion(translation=0.2, axes=(0.0,) * 3 + (0.5, 0.5, 1.0))
    path = whole_motion(ViaPointMotion(motion, ViaPoints(count=5, holds=2), 3, 1000, 100), 400)
    slopes = (path[2:, 3:6] - path[:-2, 3:6]) * 500.0
    np.testing.assert_allclose(path[1:-1, 9:], slopes, atol=1e-4)
    assert np.abs(path[:, 3:6]).max() <= 0.2
    assert not path[:, :3].any()


def test_all_robots_hold_still_at_the_same_times_and_start_anew_from_home() -> None:
    via = ViaPoints(count=6, holds=3, hold_time=4.0, hold_transit=1.0)
    motion = Motion(translation=0.1)
    blocks = round((6 * (1.4 + 0.5) + 3 * 5.0 + 1.0) * 100)
    paths = [whole_motion(ViaPointMotion(motion, via, seed, 100, 1), 2 * blocks) for seed in (1, 2, 3)]
    resting = np.all([np.abs(path[:, 9:]).max(axis=1) == 0.0 for path in paths], axis=0)
    starts = round(6 * 1.9 * 100)
    for k in range(3):
        assert resting[starts + 500 * k + 102 : starts + 500 * k + 498].all()
    for path in paths:
        heights = path[[starts + 300, starts + 800, starts + 1300], 5]
        np.testing.assert_allclose(sorted(heights), [-0.1, 0.0, 0.1], atol=1e-12)
        np.testing.assert_allclose(path[blocks], path[0], atol=1e-9)
        np.testing.assert_allclose(path[blocks:], path[:blocks], atol=1e-6)


def test_motion_on_a_sphere_keeps_the_distance_and_starts_and_ends_at_home() -> None:
    grasps = load_scenario("mocobot_d").robots.poses()
    centre = circumcentre(np.array([grasp.translation for grasp in grasps]))
    radius = np.linalg.norm(grasps[0].translation - centre)
    for grasp, reference in zip(grasps, sphere_references(grasps, 1, 100, 10), strict=True):
        path = np.concatenate([reference(block) for block in range(round(SPHERE_TIME * 10))])
        assert np.linalg.norm(path[0, 3:6]) < 1e-12
        assert np.linalg.norm(path[-1, 3:6]) < 1e-4
        places = grasp.translation + path[:, 3:6] @ grasp.rotation.T
        np.testing.assert_allclose(np.linalg.norm(places - centre, axis=1), radius, atol=1e-12)
        slopes = (path[2:, 3:6] - path[:-2, 3:6]) * 50.0
        np.testing.assert_allclose(path[1:-1, 9:], slopes, atol=2e-3)


BOXES = "boxes = [{ mass = 1.0, size = [1, 1, 1] }]"
PROPERTIES = "properties = { mass = 1.0, com = [0, 0, 0], principal = [1, 1, 1] }"


@pytest.mark.parametrize(
    ("payload", "robots", "message"),
    [
        (f"{BOXES}\n{PROPERTIES}", "", "key 'payload': found both 'boxes' and 'properties'"),
        ("", "", "key 'payload': found neither 'boxes' nor 'properties'"),
        (PROPERTIES.replace("1, 1, 1", "1, 1, 3"), "", r"principal': found \[1.0, 1.0, 3.0\], but no body"),
        (BOXES, "stiffness = [800.0, 0.0]", "key 'robots.damping'"),
    ],
)
def test_payloads_and_gimbals_that_cannot_be_are_refused(payload: str, robots: str, message: str) -> None:
    grasps = "grasps = [{ position = [0, 0, 0] }, { position = [1, 0, 0] }]"
    with pytest.raises(ScenarioError, match=message):
        parse_scenario(f'name = "x"\n[payload]\n{payload}\n[robots]\n{robots}\n{grasps}', "x.toml")
