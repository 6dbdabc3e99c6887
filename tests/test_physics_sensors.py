"""What the sensors add to the truth, and when they were read."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from scipy.special import chdtri, ndtri

from coheft.errors import SimulationError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import SENSORS, SHAPES, SensorDrift, SensorTolerance
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.physics_server.simulation import Simulation
from coheft.wire.scenario.schema import Scenario, Slip
from tests.physics_run import excitation, run, samples, scenario

UNLIKELY = 1e-6


def measured(chosen: Scenario, count: int) -> Array:
    """Measurements of a moving payload, shape (N, count, 15)."""
    return samples(run(Simulation(chosen), excitation(chosen), count // chosen.sensors.block))


def noise(count: int, name: str = "ring3", **keys: int) -> Array:
    """What the sensors add to the exact readings of the same run, in standard deviations."""
    noisy = scenario(name, noise_scale=2.0, **keys)
    return (measured(noisy, count) - measured(scenario(name, **keys), count)) / noisy.noise.per_column()


def test_noise_has_its_standard_deviation_and_no_mean():
    count = 4000
    drawn = noise(count, block=20)
    low, high = chdtri(count, [1 - UNLIKELY / 2, UNLIKELY / 2]) / count
    variance = np.square(drawn).mean(axis=1)
    assert low < variance.min()
    assert variance.max() < high
    assert np.abs(drawn.mean(axis=1)).max() < -ndtri(UNLIKELY / 2) / np.sqrt(count)


def test_noise_is_white_and_independent_of_axis_and_robot():
    count = 4000
    columns = noise(count, block=20).swapaxes(0, 1).reshape(count, -1)
    bound = -ndtri(UNLIKELY / 2) / np.sqrt(count)
    between = columns.T @ columns / count
    assert np.abs(between - np.diag(np.diag(between))).max() < bound
    lagged = columns[1:].T @ columns[:-1] / count
    assert np.abs(lagged).max() < bound


@pytest.mark.parametrize("block", [4, 20])
def test_correlated_noise_has_its_standard_deviation_and_its_memory(block: int):
    chosen = scenario(block=block, noise_scale=1.0)
    exact, sensors = scenario(block=block), msgspec.structs.replace(chosen.sensors, noise_correlation=0.01)
    slow = msgspec.structs.replace(chosen, sensors=sensors)
    drawn = (measured(slow, 8000) - measured(exact, 8000)) / slow.noise.per_column()
    assert np.square(drawn).mean() == pytest.approx(1.0, abs=0.05)
    for apart in (1, 10):
        alike = (drawn[:, apart:] * drawn[:, :-apart]).mean() / np.square(drawn).mean()
        assert alike == pytest.approx(np.exp(-apart / 10.0), abs=0.03)


@pytest.mark.parametrize("block", [4, 20])
def test_errors_wander_as_far_as_told(block: int):
    chosen = scenario("ring12", block=block)
    told = SensorDrift(gyro=0.01, acceleration=0.02, force=0.3, torque=0.04)
    sensors = msgspec.structs.replace(chosen.sensors, drift=told, errors="drawn", tolerance=SensorTolerance())
    wandered = measured(msgspec.structs.replace(chosen, sensors=sensors), 2000) - measured(chosen, 2000)
    steps = wandered[:, 400::400] - wandered[:, :-400:400]
    expected = np.repeat([0.01, 0.0, 0.02, 0.3, 0.04], 3) * np.sqrt(0.4 / 60.0)
    np.testing.assert_allclose(
        steps.std(axis=(0, 1))[[0, 1, 2, *range(6, 15)]], expected[[0, 1, 2, *range(6, 15)]], rtol=0.4
    )
    assert not wandered[..., 3:6].any()
    still = msgspec.structs.replace(chosen, sensors=msgspec.structs.replace(sensors, errors="none"))
    np.testing.assert_array_equal(measured(still, 20), measured(chosen, 20))


def test_columns_have_the_noise_of_their_sensors():
    chosen = scenario()
    std = SensorNoise(gyro=1.0, velocity=2.0, acceleration=3.0, force=4.0, torque=5.0)
    noisy = msgspec.structs.replace(
        chosen, sensors=msgspec.structs.replace(chosen.sensors, noise=std, noise_scale=1.0, block=20)
    )
    spread = (measured(noisy, 2000) - measured(chosen, 2000)).std(axis=(0, 1))
    np.testing.assert_allclose(spread, np.repeat([1.0, 2.0, 3.0, 4.0, 5.0], 3), rtol=0.1)


def test_noise_of_a_robot_depends_neither_on_the_others_nor_on_the_blocks():
    few = noise(40)
    np.testing.assert_allclose(noise(40, "ring12")[:3], few, atol=1e-9)
    np.testing.assert_allclose(noise(40, block=20), few, atol=1e-9)


ERRORS = SensorTolerance(
    gyro_offset=0.01, acceleration_offset=0.1, force_offset=2.0, torque_offset=0.2, force_gain=0.02, torque_gain=0.01
)


def with_errors(chosen: Scenario, **keys: SensorTolerance | str) -> Scenario:
    return msgspec.structs.replace(chosen, sensors=msgspec.structs.replace(chosen.sensors, **keys))


def test_errors_are_constant_as_large_as_told_and_each_robots_own():
    exact = scenario("ring24")
    truth, read = measured(exact, 20), measured(with_errors(exact, tolerance=ERRORS), 20)
    force = slice(9, 15)
    gains = np.stack([read[:, 1:, k] - read[:, :1, k] for k in range(9, 15)], axis=-1)
    steps = truth[:, 1:, force] - truth[:, :1, force]
    of_axes = np.einsum("nbk,nbk->nk", gains, steps) / np.einsum("nbk,nbk->nk", steps, steps) - 1.0
    np.testing.assert_allclose(of_axes, np.repeat(of_axes[:, [0, 3]], 3, axis=1), atol=1e-9)
    offsets = read - truth
    offsets[..., force] -= truth[..., force] * of_axes[:, None]
    np.testing.assert_allclose(offsets, np.broadcast_to(offsets[:, :1], offsets.shape), atol=1e-9)
    assert not offsets[..., 3:6].any()
    for drawn, told in ((offsets[:, 0, :3], 0.01), (offsets[:, 0, 6:9], 0.1), (offsets[:, 0, 9:12], 2.0)):
        assert len(np.unique(drawn.round(9))) == drawn.size
        low, high = chdtri(drawn.size, [1 - UNLIKELY / 2, UNLIKELY / 2])
        assert low < np.square(drawn / told).sum() < high
    for drawn, told in ((of_axes[:, 0], 0.02), (of_axes[:, 3], 0.01)):
        low, high = chdtri(drawn.size, [1 - UNLIKELY / 2, UNLIKELY / 2])
        assert low < np.square(drawn / told).sum() < high


PROPORTIONAL = [
    *((sensor, shape) for sensor in SENSORS for shape in ("scale", "cross_talk")),
    *((sensor, "mounting") for sensor in ("gyro", "velocity", "acceleration")),
]
"""The frame of forces and torques is that of their sensor."""


@pytest.mark.parametrize(("sensor", "shape"), PROPORTIONAL)
def test_errors_that_are_proportional_are_as_large_as_told(sensor: str, shape: str):
    exact, size = scenario("ring24"), 0.01 if shape != "mounting" else 1.0
    key = f"{sensor}_{shape}" if shape != "mounting" else f"{sensor}_mounting_deg"
    truth, read = measured(exact, 60), measured(with_errors(exact, tolerance=SensorTolerance(**{key: size})), 60)
    first = 3 * SENSORS.index(sensor)
    others = np.r_[0:first, first + 3 : 15]
    np.testing.assert_allclose(read[:, :, others], truth[:, :, others], atol=1e-12)
    found = [
        np.linalg.lstsq(t, r, rcond=None)[0].T - np.eye(3)
        for t, r in zip(truth[..., first : first + 3], read[..., first : first + 3], strict=True)
    ]
    told = SensorTolerance(**{key: size}).of(sensor, shape)
    drawn = np.array([[np.vdot(matrix, each) / np.vdot(matrix, matrix) for matrix in SHAPES[shape]] for each in found])
    low, high = chdtri(drawn.size, [1 - UNLIKELY / 2, UNLIKELY / 2])
    assert low < np.square(drawn / told).sum() < high
    rest = found - np.tensordot(drawn, SHAPES[shape], axes=1)
    assert np.abs(rest).max() < 20.0 * told**2


@pytest.mark.parametrize("rate", [1000, 100])
def test_late_sensors_read_what_there_was(rate: int):
    exact = scenario("ring12", rate=rate, block=4)
    told = SensorTolerance(clock=0.004, wrench_delay=0.002)
    truth, read = measured(exact, 200), measured(with_errors(exact, errors=told), 200)
    late = SensorErrors.drawn(with_errors(exact, errors=told), 12).delays
    assert late.min() == 0.0
    spread = late - late.mean(axis=0)
    for drawn, size in ((spread[:, 0], told.clock), (late[:, 1] - late[:, 0], told.wrench_delay)):
        low, high = chdtri(11, [1 - UNLIKELY / 2, UNLIKELY / 2])
        assert low < np.square((drawn - drawn.mean()) / size).sum() < high
    times = np.arange(200) / rate
    for robot in range(12):
        for columns, delay in ((slice(0, 9), late[robot, 0]), (slice(9, 15), late[robot, 1])):
            for column in range(*columns.indices(15)):
                then = np.interp(times - delay, times, truth[robot, :, column])
                np.testing.assert_allclose(read[robot, :, column], then, atol=1e-9)


def test_delays_do_not_depend_on_the_block():
    errors = SensorTolerance(clock=0.004, wrench_delay=0.002)
    small, large = (with_errors(scenario(block=block), errors=errors) for block in (4, 20))
    np.testing.assert_allclose(measured(small, 80)[:, :20], measured(large, 80)[:, :20], atol=1e-9)


@pytest.mark.parametrize("told", [SensorTolerance(), SensorTolerance(clock=0.004, wrench_delay=0.002)])
def test_a_clock_that_is_set_during_a_run_delays_one_robot_from_the_next_block_on(told: SensorTolerance):
    chosen = with_errors(scenario(rate=500, block=4), errors=told)
    now, drawn = Simulation(chosen), SensorErrors.drawn(chosen, 3).delays
    move = excitation(chosen)
    read = [samples(run(now, move, 20))]
    now.set_clock("r2", 0.011)
    read.append(samples(run(now, move, 20)))
    now.set_clock("r2", 0.0)
    read.append(samples(run(now, move, 10)))
    truth, times = measured(scenario(rate=500, block=4), 200), np.arange(200) / 500
    ahead = 0.011 * ((times >= 0.16) & (times < 0.32))
    for robot in range(3):
        for column in range(15):
            then = times - drawn[robot, int(column >= 9)] - (ahead if robot == 1 else 0.0)
            expected = np.interp(then, times, truth[robot, :, column])
            np.testing.assert_allclose(np.hstack(read)[robot, :, column], expected, atol=1e-9)


def test_the_largest_clock_comes_on_top_of_the_delays():
    chosen = with_errors(scenario(rate=100, block=2), errors=SensorTolerance(clock=0.05, wrench_delay=0.05))
    now, latest = Simulation(chosen), SensorErrors.drawn(chosen, 3).delays.max(axis=1).argmax()
    before = samples(run(now, excitation(chosen), 60))
    now.set_clock(chosen.robot_names[latest], 1.0)
    read = np.hstack([before, samples(run(now, excitation(chosen), 10))])
    delays = SensorErrors.drawn(chosen, 3).delays[latest] + 1.0
    truth, times = measured(scenario(rate=100, block=2), 140), np.arange(140) / 100
    for column in range(15):
        expected = np.interp(times - delays[int(column >= 9)], times, truth[latest, :, column])
        np.testing.assert_allclose(read[latest, 120:, column], expected[120:], atol=1e-9)


def test_a_clock_that_cannot_be_set_is_explained():
    simulation = Simulation(scenario())
    for ahead in (-0.001, 1.5, np.nan):
        with pytest.raises(SimulationError, match="a clock may be 0 to 1 s ahead"):
            simulation.set_clock("r1", ahead)
    with pytest.raises(SimulationError, match="there is no robot r9"):
        simulation.set_clock("r9", 0.1)


@pytest.mark.parametrize("arms", ["impedance", "seven-joint"])
def test_sensors_read_at_their_places(arms: str):
    exact = scenario("arms4" if arms == "seven-joint" else "ring3")
    moved = with_errors(exact, errors=SensorTolerance(velocity_place=0.05, acceleration_place=0.05))
    truth, read = measured(exact, 200), measured(moved, 200)
    drawn = SensorErrors.drawn(moved, len(exact.robot_names))
    for robot, (at_velocity, at_acceleration) in enumerate(
        zip(drawn.velocity_places, drawn.acceleration_places, strict=True)
    ):
        w = truth[robot, :, :3]
        alpha = np.gradient(w, 1e-3, axis=0)
        np.testing.assert_allclose(read[robot, :, 3:6], truth[robot, :, 3:6] + np.cross(w, at_velocity), atol=1e-9)
        there = truth[robot, :, 6:9] + np.cross(alpha, at_acceleration) + np.cross(w, np.cross(w, at_acceleration))
        np.testing.assert_allclose(read[robot, 100:-2, 6:9], there[100:-2], atol=0.02)
        assert np.abs(read[robot, :, 6:9] - truth[robot, :, 6:9]).max() > 0.04
    np.testing.assert_array_equal(read[..., [0, 1, 2, *range(9, 15)]], truth[..., [0, 1, 2, *range(9, 15)]])


def limp(name: str = "ring3", size: float = 1e-4, **keys: int) -> Scenario:
    return with_errors(scenario(name, **keys), errors=SensorTolerance(grasp_compliance=size))


def changing(vectors: Array, w: Array, rate: float) -> Array:
    """How fast vectors (..., n, 3) change in axes that do not turn."""
    rates: Array = np.gradient(vectors, 1.0 / rate, axis=-2) + np.cross(w, vectors)
    return rates


@pytest.mark.parametrize("arms", ["impedance", "seven-joint"])
def test_hands_move_against_the_load_by_compliance_times_force(arms: str):
    compliant = limp("arms4" if arms == "seven-joint" else "ring3")
    truth = measured(with_errors(compliant, errors="none"), 400)
    read = measured(compliant, 400)
    compliances = SensorErrors.drawn(compliant, len(truth)).compliances
    assert (compliances > 0.0).all()
    w = truth[..., :3]
    velocity = changing(compliances[:, None, None] * truth[..., 9:12], w, 1000.0)
    added = np.concatenate([velocity, changing(velocity, w, 1000.0)], axis=2)
    scale = np.abs(added[:, 200:-4]).max(axis=(0, 1))
    np.testing.assert_allclose(
        (read - truth)[:, 200:-4, 3:9] / scale, added[:, 200:-4] / scale, atol=0.05 if arms == "seven-joint" else 0.005
    )
    np.testing.assert_array_equal(read[..., [0, 1, 2, *range(9, 15)]], truth[..., [0, 1, 2, *range(9, 15)]])


def test_compliance_is_drawn_with_its_deviation_and_changes_no_other_error():
    compliant = with_errors(scenario("ring24"), tolerance=msgspec.structs.replace(ERRORS, grasp_compliance=1e-4))
    one, other = (
        SensorErrors.drawn(each, 24) for each in (with_errors(scenario("ring24"), tolerance=ERRORS), compliant)
    )
    for name, value in vars(one).items():
        if name != "compliances":
            np.testing.assert_array_equal(getattr(other, name), value)
    low, high = chdtri(24, [1 - UNLIKELY / 2, UNLIKELY / 2])
    assert low < np.square(other.compliances / 1e-4).sum() < high
    assert not one.compliances.any()


def test_compliance_does_not_depend_on_the_block():
    np.testing.assert_allclose(
        measured(limp(block=4), 80)[:, :20], measured(limp(block=20), 80)[:, :20], rtol=1e-9, atol=1e-9
    )


def test_hands_that_let_go_take_hold_or_slip_do_not_jump():
    compliant = msgspec.structs.replace(
        limp("ring6"), slips=(Slip(at=0.06, robot="r3", translation=(0.005, 0.0, 0.0)),), duration=0.2
    )
    stiff = with_errors(compliant, errors="none")
    found = []
    for chosen in (compliant, stiff):
        simulation, references = Simulation(chosen), excitation(chosen)
        read = [samples(run(simulation, references, 4))]
        simulation.release("r2")
        read.append(samples(run(simulation, references, 4)))
        simulation.grasp("r2")
        read.append(samples(run(simulation, references, 8)))
        found.append(np.concatenate(read, axis=1))
    added = np.linalg.norm((found[0] - found[1])[..., 3:6], axis=2)
    assert not added[1, 20:40].any()
    # A force of 20 N that comes or goes within a millisecond would be worth 1 m/s.
    assert 0.0 < added[1, 40] < 0.01
    assert 0.0 < added[2, 60] < 0.01
    assert added[:, 62:].max() > 0.05


def test_true_errors_may_be_others_than_told_or_none():
    exact = scenario()
    np.testing.assert_array_equal(
        measured(with_errors(exact, tolerance=ERRORS, errors="none"), 20), measured(exact, 20)
    )
    np.testing.assert_array_equal(
        measured(with_errors(exact, errors=ERRORS), 20), measured(with_errors(exact, tolerance=ERRORS), 20)
    )


def test_noise_is_the_same_with_errors_and_without():
    chosen, exact = scenario(noise_scale=1.0), scenario()
    noisy, clean = (with_errors(each, errors=ERRORS) for each in (chosen, exact))
    np.testing.assert_allclose(
        measured(noisy, 20) - measured(clean, 20), measured(chosen, 20) - measured(exact, 20), atol=1e-9
    )


def test_samples_were_taken_at_their_stamps():
    """Arms that hold still are the same at every rate, so sample b of 250 a second is sample 4 b of 1000 a second."""
    every, fourth = scenario(rate=1000, block=20), scenario(rate=250, block=5)
    fast, slow = Simulation(every), Simulation(fourth)
    for simulation in (fast, slow):
        simulation.inject(2.0, (0.2, -0.1, 0.1))
    one = samples([fast.advance({}) for _ in range(10)])
    other = samples([slow.advance({}) for _ in range(10)])
    assert (one[:, 0, :6] == 0.0).all()
    assert np.abs(one[:, 1, :6]).min() > 0.0
    np.testing.assert_array_equal(other, one[:, ::4])


def test_truth_belongs_to_the_last_sample():
    exact = scenario(rate=250, block=5)
    fine = Simulation(scenario(rate=1000, block=4))
    fine.inject(1.0, (0.1, 0.2, 0.0))
    coarse = Simulation(exact)
    coarse.inject(1.0, (0.1, 0.2, 0.0))
    truth = coarse.advance({}).truth
    assert truth.time == pytest.approx(0.02)
    # The last of five samples at 250 Hz was taken at 16 ms: the state in which the fine run begins its fifth block.
    for _ in range(4):
        fine.advance({})
    np.testing.assert_array_equal(fine.data.qpos, np.concatenate([truth.position, truth.quaternion]))


def test_equal_scenarios_and_references_give_equal_bits():
    noisy = scenario("ring6", noise_scale=1.0)
    np.testing.assert_array_equal(measured(noisy, 200), measured(noisy, 200))
    other = msgspec.structs.replace(noisy, seed=noisy.seed + 1)
    assert (measured(other, 20) != measured(noisy, 20)).all()
