"""Robots whose sensors differ: in the scenario, in the simulation, in what each robot knows, and in a whole run."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.agents.efficient.settings import fit_settings
from coheft.app.results.judge import Judge
from coheft.app.results.quantities import directed_edges, published_errors
from coheft.app.run.inprocess import TeamInProcess
from coheft.app.study.samples import simulate, with_exact_sensors
from coheft.app.terminal.notes import notes
from coheft.errors import ScenarioError, UsageError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.estimators import Team
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.messages.size import largest_message
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.robot_sensors import OtherSensors
from coheft.wire.scenario.schema import Scenario

NOISY = '{ robot = "r2", noise_scale = 5 }'


def with_others(name: str, *others: str, duration: float = 1.0) -> Scenario:
    """A scenario without load changes, with other sensors in TOML."""
    return load_scenario(name, [f"sensors.of=[{', '.join(others)}]", f"duration={duration}", "load_changes=[]"])


def settings_of(scenario: Scenario, robot: str) -> AgentConfig:
    return agent_config(scenario, robot, ())


def test_what_is_left_out_is_as_for_all_robots() -> None:
    scenario = with_others("real3", NOISY, '{ robot = "r3", tolerance = { force_offset = 2 }, noise = { gyro = 0.1 } }')
    one, two, three = scenario.robot_sensors()
    assert (one.noise, one.tolerance) == (SensorNoise(), INDUSTRIAL)
    assert (two.noise, two.tolerance) == (SensorNoise().scaled(5.0), INDUSTRIAL)
    assert (three.noise, three.tolerance) == (SensorNoise(gyro=0.1), SensorTolerance(force_offset=2.0))


def test_factors_of_noise_multiply() -> None:
    scenario = load_scenario("ring3", ["sensors.noise_scale=2", f"sensors.of=[{NOISY}]"])
    assert scenario.robot_sensors()[1].noise == SensorNoise().scaled(10.0)


@pytest.mark.parametrize(
    ("other", "complaint"),
    [
        ('{ robot = "r4" }', "key 'sensors.of[0].robot': found 'r4', expected one of the robots r1, r2, r3"),
        (f"{NOISY}, {NOISY}", "key 'sensors.of[1].robot': found 'r2' a second time, expected each robot once"),
        ("{ noise_scale = 2 }", "key 'sensors.of[0].robot': it is missing, but required"),
        ('{ robot = "r2", scale = 2 }', "key 'sensors.of[0].scale': there is no such key. Did you mean 'noise_scale'?"),
        ('{ robot = "r2", noise = { gyros = 1 } }', "key 'sensors.of[0].noise.gyros': there is no such key"),
        ('{ robot = "r2", noise_scale = 0 }', "key 'sensors.of[0].noise_scale': expected a number greater than 0"),
        ('{ robot = "r2", noise_scale = 1e-4 }', "key 'sensors.of[0]': found noise of the gyro of r2 of 5e-07"),
    ],
)
def test_unknown_robots_and_keys_are_refused_in_words(other: str, complaint: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        with_others("ring3", other)
    assert complaint in str(caught.value)


def test_a_team_of_ones_own_takes_them_and_refuses_unknown_robots() -> None:
    team = Team(["left", "right"], sensors={"of": [{"robot": "right", "noise_scale": 3}]})
    assert team.robots == ("left", "right")
    with pytest.raises(UsageError, match=r"found 'middle', expected one of the robots left, right"):
        Team(["left", "right"], sensors={"of": [{"robot": "middle"}]})


def test_noise_is_that_of_each_robot() -> None:
    alike, unequal = (simulate(with_others("ring3", *others)).samples for others in ((), (NOISY,)))
    exact = simulate(with_exact_sensors(with_others("ring3"))).samples
    np.testing.assert_array_equal(unequal[:, [0, 2]], alike[:, [0, 2]])
    np.testing.assert_allclose((unequal - exact)[:, 1], 5.0 * (alike - exact)[:, 1], atol=1e-9)


def test_errors_are_drawn_from_the_tolerances_of_each_robot() -> None:
    sheet = {key: 3.0 * getattr(INDUSTRIAL, key) for key in ("force_offset", "gyro_offset")} | {
        "grasp_compliance": 1e-5
    }
    inner = ", ".join(f"{key} = {value}" for key, value in sheet.items())
    alike, unequal = (
        SensorErrors.drawn(with_others("real3", *others), 3)
        for others in ((), (f'{{ robot = "r2", tolerance = {{ {inner} }} }}',))
    )
    np.testing.assert_array_equal(unequal.offsets[[0, 2]], alike.offsets[[0, 2]])
    np.testing.assert_array_equal(unequal.matrices[[0, 2]], alike.matrices[[0, 2]])
    np.testing.assert_allclose(unequal.offsets[1, [0, 9]], 3.0 * alike.offsets[1, [0, 9]])
    assert not unequal.offsets[1, 6:9].any()  # its accelerometer is exact
    assert list(unequal.compliances > 0.0) == [False, True, False]


def test_all_robots_know_the_same_of_each_other_whatever_the_team() -> None:
    scenario = with_others("real6", '{ robot = "r2", noise_scale = 5, tolerance = { grasp_compliance = 1e-5 } }')
    own, other = (fit_settings(settings_of(scenario, name), scenario.robot_names) for name in ("r1", "r2"))
    np.testing.assert_array_equal(own.noise.kinematics, other.noise.kinematics)
    np.testing.assert_array_equal(own.errors.deviations, other.errors.deviations)
    scales = own.noise.kinematics[:, 0] / own.noise.kinematics[0, 0]
    np.testing.assert_allclose(scales, [1, 5, 1, 1, 1, 1])
    assert np.ndim(own.force_offset) == 1
    # Without r2 all are alike, but its kind of error keeps its place: priors can be taken from team to team.
    fewer = fit_settings(settings_of(scenario, "r1"), ["r1", "r3", "r4"])
    assert fewer.errors.names == own.errors.names
    assert len(fewer.noise.kinematics) == len(fewer.errors.deviations) == 1
    assert own.anchor == 0
    assert fit_settings(settings_of(scenario, "r1"), ["r2", "r3", "r4"]).anchor == 1


def test_equal_robots_are_one_and_the_same_to_the_fits() -> None:
    plain = fit_settings(settings_of(load_scenario("real3"), "r1"), ["r1", "r2", "r3"])
    listed = fit_settings(settings_of(with_others("real3", '{ robot = "r2" }'), "r1"), ["r1", "r2", "r3"])
    np.testing.assert_array_equal(plain.noise.kinematics, listed.noise.kinematics)
    np.testing.assert_array_equal(plain.errors.deviations, listed.errors.deviations)
    assert (plain.force_offset, plain.gyro_offset) == (listed.force_offset, listed.gyro_offset)


def test_messages_have_room_for_what_any_robot_declares() -> None:
    one = largest_message(with_others("ring3", '{ robot = "r2", tolerance = { clock = 1e-3 } }'))
    assert one > largest_message(with_others("ring3"))


UNEQUAL = (
    OtherSensors(robot="r1", noise_scale=5.0),
    OtherSensors(
        robot="r2",
        tolerance=SensorTolerance(**{key: 3.0 * getattr(INDUSTRIAL, key) for key in INDUSTRIAL.__struct_fields__}),
    ),
    OtherSensors(robot="r3", tolerance=msgspec.structs.replace(INDUSTRIAL, grasp_compliance=2e-5)),
)


def outcome(true: Scenario, told: Scenario) -> tuple[list[float], list[float], set[tuple[str, str]]]:
    """Run; the NEES of poses and of all ten at the end, sizes of errors in valid reports, and all reasons."""
    team = TeamInProcess(true)
    team.start_agents(told)
    exact = simulate(with_exact_sensors(true))
    judge, edges = Judge(exact.scene, exact.truths), directed_edges(exact.scene.neighbours)
    latest, sizes, reasons = {}, list[float](), set[tuple[str, str]]()
    for _ in range(true.blocks):
        outboxes = team.answer(team.measure().measurements, team.received())
        found = {name: each.estimate for name, each in outboxes.items() if each.estimate is not None}
        latest |= found
        reasons |= {(name, reason) for name, each in found.items() for reason in each.reasons}
        errors = published_errors(judge, edges, {n: each for n, each in found.items() if each.status == "valid"})
        for values, covariances in (
            (errors.poses, errors.covariances.poses),
            (errors.payload, errors.covariances.payload),
        ):
            own = np.abs(values) / np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
            sizes += own[np.isfinite(own)].tolist()
    last = published_errors(judge, edges, latest)
    return [_nees(last.poses, last.covariances.poses), _nees(last.payload, last.covariances.payload)], sizes, reasons


def _nees(errors: Array, covariances: Array) -> float:
    each = [
        e @ np.linalg.solve(c, e) / len(e) for e, c in zip(errors, covariances, strict=True) if np.isfinite(e).all()
    ]
    return float(np.mean(each)) if each else np.nan


@pytest.mark.slow
def test_unequal_robots_are_as_sure_as_they_may_be() -> None:
    every, largest = [], 0.0
    for seed in range(21, 24):
        shipped = load_scenario("real3", ["duration=7", "load_changes=[]", f"seed={seed}"])
        scenario = msgspec.structs.replace(shipped, sensors=msgspec.structs.replace(shipped.sensors, of=UNEQUAL))
        nees, sizes, _ = outcome(scenario, scenario)
        every.append(nees)
        largest = max(largest, *sizes)
    assert largest < 5.0
    assert (np.mean(every, axis=0) > 0.4).all()
    assert (np.mean(every, axis=0) < 1.8).all()


@pytest.mark.slow
def test_a_robot_that_is_noisier_than_told_is_named_and_no_estimate_is_valid() -> None:
    _, sizes, reasons = outcome(with_others("ring3", NOISY, duration=6.0), with_others("ring3", duration=6.0))
    assert not sizes
    assert {name for name, reason in reasons if "outliers" in reason} == {"r2"}


@pytest.mark.slow
@pytest.mark.parametrize(("missing", "known"), [("torque", 4), ("wrench", 0)])
def test_what_needs_a_wrench_that_is_not_measured_is_not_known(missing: str, known: int) -> None:
    team = TeamInProcess(with_others("ring3", f'{{ robot = "r2", missing = "{missing}" }}', duration=4.0))
    for _ in range(200):
        measured = team.measure().measurements
        outboxes = team.answer(measured, team.received())
    rows = measured["r2"].samples
    assert not rows[:, 12 if missing == "torque" else 9 :].any()
    assert rows[:, :9].all()
    for outbox in outboxes.values():
        estimate = outbox.estimate
        assert estimate is not None
        assert estimate.phase == "inertia"
        assert (0 if estimate.payload is None else len(estimate.payload.covariance)) == known
        needed = "force" if missing == "wrench" else "torque"
        told = f"inertia: no motion shows it while a robot that holds the load does not measure its {needed}"
        assert told in estimate.not_observable
        assert (estimate.status == "valid") == (known > 0)
        if estimate.payload is not None:
            assert abs(estimate.payload.mass - 5.0) < 5.0 * estimate.payload.covariance[0, 0] ** 0.5


def test_recordings_of_wrists_with_encoders_have_all_wrenches() -> None:
    with pytest.raises(ScenarioError, match=r"'sensors.of\[0\].missing': found with 'sensors.encoders'"):
        load_scenario("mocobot_a", ['sensors.of=[{ robot = "r1", missing = "torque" }]'])


def test_a_method_for_equal_robots_is_said_to_report_no_payload() -> None:
    (note,) = notes(load_scenario("ring3", ["estimator=fan2017", f"sensors.of=[{NOISY}]"]))
    assert "robots that differ" in note
    team = TeamInProcess(load_scenario("ring3", ["estimator=fan2017", f"sensors.of=[{NOISY}]"]))
    for _ in range(10):
        outboxes = team.answer(team.measure().measurements, team.received())
    estimate = outboxes["r1"].estimate
    assert estimate is not None
    assert "sensors" in " ".join(estimate.not_observable)
