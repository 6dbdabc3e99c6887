"""Robots without a gyro, a velocity sensor or an accelerometer: in the scenario, in fits, and in whole runs."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.agents.efficient.judge import Outcome
from coheft.agents.efficient.session import Session
from coheft.agents.efficient.settings import Guards, fit_settings
from coheft.agents.efficient.stages import Stage
from coheft.app.faults.invariants import Watch
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import AnyFault, FaultSchedule, Release, SensorFault
from coheft.app.run.inprocess import TeamInProcess
from coheft.app.study.bounds import ExactRun
from coheft.app.study.samples import simulate, with_exact_sensors
from coheft.errors import ScenarioError, UsageError
from coheft.estimation.batch.recording import RobotRecord
from coheft.estimation.measurement import MeasurementBlock, SensorNoise
from coheft.estimation.moments.fit_settings import FitSettings
from coheft.estimation.moments.rows import ROW_SIZE, RowNoise
from coheft.estimation.tolerance import INDUSTRIAL, SensorTolerance
from coheft.estimators import Team
from coheft.physics_server.data_recorder import DataRecorder
from coheft.wire.config import AgentConfig, agent_config
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.robot_sensors import OtherSensors, RobotSensors
from coheft.wire.scenario.schema import Scenario
from tests.efficient.rows import LOAD, PERIOD, POSES, made_up_rows

COLUMNS = {"gyro": slice(0, 3), "velocity": slice(3, 6), "acceleration": slice(6, 9)}
EACH = pytest.mark.parametrize("missing", COLUMNS)


def without(name: str, missing: str, robot: str = "r2", duration: float = 1.0, *more: str) -> Scenario:
    """A scenario without load changes in which a robot misses these sensors, in TOML."""
    other = f'sensors.of=[{{ robot = "{robot}", missing = {missing} }}]'
    return load_scenario(name, [other, f"duration={duration}", "load_changes=[]", *more])


@pytest.mark.parametrize(
    ("told", "missing"),
    [
        ('"gyro"', ("gyro",)),
        ('"wrench"', ("force", "torque")),
        ('["torque", "velocity"]', ("velocity", "torque")),
        ('["acceleration", "wrench"]', ("acceleration", "force", "torque")),
        ("[]", ()),
    ],
)
def test_one_or_several_sensors_may_be_missing(told: str, missing: tuple[str, ...]) -> None:
    scenario = without("real3", told)
    own = scenario.robot_sensors()[1]
    assert own.missing == missing
    # Every robot knows that, and that errors of no sensor are no errors.
    for name in scenario.robot_names:
        config = msgspec.json.decode(msgspec.json.encode(agent_config(scenario, name, ())), type=AgentConfig)
        assert config.sensors_of("r2") == own
    for sensor in ("gyro", "velocity", "acceleration", "force", "torque"):
        expected = 0.0 if sensor in missing else getattr(INDUSTRIAL, f"{sensor}_scale")
        assert getattr(own.tolerance, f"{sensor}_scale") == expected
    assert own.tolerance.clock == INDUSTRIAL.clock


@pytest.mark.parametrize(
    ("of", "complaint"),
    [
        ('missing = "gyros"', '"velocity", "wrench", or a list of several; found "gyros"'),
        ('missing = ["gyro", "wrist"]', "key 'sensors.of[0].missing[1]': expected one of"),
        ('missing = ["velocity", "acceleration"]', "expected a velocity sensor or an accelerometer at least"),
        (
            'missing = "gyro", tolerance = { velocity_place = 0.01 }',
            "found gyro with velocity_place = 0.01, expected 0",
        ),
        ('missing = "gyro", tolerance = { grasp_compliance = 1e-5 }', "with grasp_compliance = 1e-05, expected 0"),
        ('missing = "wrench", tolerance = { grasp_compliance = 1e-5 }', "with grasp_compliance = 1e-05, expected 0"),
    ],
)
def test_what_cannot_be_is_refused_in_words(of: str, complaint: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load_scenario("real3", [f'sensors.of=[{{ robot = "r2", {of} }}]'])
    assert complaint in str(caught.value)


@pytest.mark.parametrize(("missing", "name"), [("gyro", "gyro"), ("acceleration", "accelerometer")])
def test_a_team_needs_one_of_a_kind(missing: str, name: str) -> None:
    of = [{"robot": robot, "missing": missing} for robot in ("a", "b")]
    Team(["a", "b", "c"], sensors={"of": of})
    with pytest.raises(UsageError, match=f"found the {name} missing of all robots"):
        Team(["a", "b"], sensors={"of": of})


def test_what_another_estimator_or_carrying_needs_may_not_be_missing() -> None:
    with pytest.raises(ScenarioError, match="found velocity sensor with 'estimator' = 'fan2017'"):
        without("ring3", '"velocity"', "r2", 1.0, "estimator=fan2017")
    without("carry6", '"gyro"')
    with pytest.raises(ScenarioError, match=r"found accelerometer with 'carry.feedforward' = true"):
        without("carry6", '"acceleration"')
    without("carry6", '"acceleration"', "r2", 1.0, "carry.feedforward=false")


@EACH
def test_rows_of_what_is_missing_have_no_weight(missing: str) -> None:
    scenario = without("real3", f'"{missing}"')
    settings = fit_settings(agent_config(scenario, "r1", ()), scenario.robot_names)
    finite = np.isfinite(settings.noise.kinematics)
    places = {"gyro": [0, 1, 2, 9, 10, 11], "velocity": [3, 4, 5], "acceleration": [6, 7, 8]}[missing]
    assert np.flatnonzero(~finite[1]).tolist() == places
    assert finite[[0, 2]].all()
    assert np.isfinite(settings.noise.wrench).all()


def test_the_anchor_is_a_robot_that_misses_nothing() -> None:
    of = '[{ robot = "r1", missing = "velocity", noise_scale = 0.5 }, { robot = "r2", noise_scale = 2 }]'
    scenario = load_scenario("ring3", [f"sensors.of={of}"])
    assert fit_settings(agent_config(scenario, "r1", ()), scenario.robot_names).anchor == 2
    assert fit_settings(agent_config(scenario, "r1", ()), ["r1", "r2"]).anchor == 1


@EACH
def test_what_is_missing_reads_zero_and_is_not_recorded(missing: str) -> None:
    scenario = without("ring3", f'"{missing}"', "r2", 0.1)
    team, recorder = TeamInProcess(scenario), None
    for _ in range(scenario.blocks):
        result = team.measure()
        recorder = recorder or DataRecorder(scenario, team.simulation.scene)
        recorder.add(result)
    assert recorder is not None
    samples = result.measurements["r2"].samples
    assert not samples[:, COLUMNS[missing]].any()
    assert (samples != 0.0).sum() == 12 * len(samples)
    robots = recorder.recording().robots
    channel = "acceleration" if missing == "acceleration" else "twist"
    kept = {"twist", "acceleration", "wrench"} - {channel}
    assert getattr(robots["r2"], channel) is None
    assert all(getattr(robots["r2"], each) is not None for each in kept)
    assert robots["r1"].twist is not None


def test_a_channel_that_is_recorded_in_part_is_left_out() -> None:
    record = RobotRecord(np.arange(3.0), twist=np.ones((3, 6)), wrench=np.ones((3, 6)), pose=np.ones((3, 7)))
    kept = RobotSensors(SensorNoise(), SensorTolerance(), ("torque",)).recorded(record)
    assert kept.wrench is None
    assert (kept.twist is record.twist, kept.pose is record.pose) == (True, True)


@EACH
def test_the_bound_knows_what_is_missing(missing: str) -> None:
    """Its poses are less certain, by what is missing and by nothing else."""
    edges = [("r1", "r2"), ("r1", "r3")]
    bounds = []
    for scenario in (load_scenario("ring3", ["duration=2", "load_changes=[]"]), without("ring3", f'"{missing}"')):
        exact = msgspec.structs.replace(with_exact_sensors(scenario), duration=2.0)
        run = ExactRun(msgspec.structs.replace(scenario, duration=2.0), simulate(exact), edges)
        bounds.append(run.seen(run.information(0, exact.blocks).full_bound()))
    traces = [np.trace(bound.poses, axis1=1, axis2=2) for bound in bounds]
    assert traces[1][0] > 1.05 * traces[0][0]
    assert np.isfinite(traces).all()


@EACH
def test_poses_and_load_are_found_and_right_without_it(missing: str) -> None:
    scenario = without("ring3", f'"{missing}"', "r2", 1.2)
    for estimate in last_estimates(scenario).values():
        assert estimate.status == "valid"
        assert estimate.phase == "inertia"
        assert len(estimate.poses) == 2
        assert estimate.payload is not None
        assert len(estimate.payload.covariance) == 10
        assert abs(estimate.payload.mass - 5.0) < 5.0 * estimate.payload.covariance[0, 0] ** 0.5


def test_a_driver_may_send_anything_instead_of_what_is_missing() -> None:
    scenario = without("ring3", '"gyro"', "r2", 0.8)
    zeros, anything = (last_estimates(scenario, instead) for instead in (0.0, np.nan))
    assert {each.status for each in anything.values()} == {"valid"}
    for name, each in zeros.items():
        one, other = each.payload, anything[name].payload
        assert one is not None
        assert other is not None
        assert one.mass == other.mass
        np.testing.assert_array_equal(one.covariance, other.covariance)


def last_estimates(scenario: Scenario, instead: float = 0.0) -> dict[str, Estimate]:
    """Run; the last estimates, if the gyro of r2 reads ``instead`` where it reads zero."""
    team, latest = TeamInProcess(scenario), dict[str, Estimate]()
    for index in range(scenario.blocks):
        blocks = {name: MeasurementBlock(index, each.samples) for name, each in team.measure().measurements.items()}
        blocks["r2"].samples[blocks["r2"].samples == 0.0] = instead
        outboxes = team.answer(blocks, team.received())
        latest |= {name: each.estimate for name, each in outboxes.items() if each.estimate is not None}
    return latest


def session_without(places: list[int], robots: list[int], scale: float = 1.0) -> tuple[Session, set[Outcome]]:
    """A session on rows of four robots, of which some read zeros at these places, after 120 rows; and all outcomes.

    ``scale`` multiplies the noise of motion sensors that it is told.
    """
    noise = RowNoise.of_samples(SensorNoise(), 20, 1000.0)
    kinematics, rows = scale * np.repeat(noise.kinematics, len(POSES), axis=0), made_up_rows(120)
    kinematics[np.ix_(robots, places)] = np.inf
    for robot in robots:
        rows[:, ROW_SIZE * robot + np.array(places)] = 0.0
    settings = FitSettings(RowNoise(kinematics, noise.wrench), PERIOD)
    found, outcomes = Session(len(POSES), 0, settings, Guards()), set[Outcome]()
    for number, row in enumerate(rows):
        found.take(number, row)
        outcomes.add(found.verdict.outcome)
        assert found.contradicting is None
        assert found.undeclared is None
    return found, outcomes


def test_no_test_of_a_session_sees_what_is_missing() -> None:
    found, outcomes = session_without([3, 4, 5], [2])
    assert outcomes == {Outcome.FITS}
    assert found.stage is Stage.ESTIMATING
    state = found.estimate.state if found.estimate is not None else None
    assert state is not None
    assert state.load is not None
    assert np.abs(state.load[6:] - LOAD).max() < 0.3
    for pose, true in zip(state.poses, POSES, strict=True):
        assert np.abs(pose.translation - true.translation).max() < 0.02


def test_too_noisy_sensors_show_although_some_are_missing() -> None:
    """Sums of squares are compared with those of the sensors that are there."""
    assert Outcome.NO_BODY in session_without([0, 1, 2, 6, 7, 8, 9, 10, 11], [1, 2, 3], scale=0.75)[1]


def test_offsets_from_before_a_slip_are_finite() -> None:
    found, _ = session_without([3, 4, 5], [2])
    past = found._known.innovations.past_before_slip
    assert np.isfinite(past.mean).all()
    assert not past.mean[2 * ROW_SIZE + 3 : 2 * ROW_SIZE + 6].any()


class Story:
    """A run of line4 of which r1 alone has a gyro, with faults; what robots published."""

    def __init__(self, faults: list[AnyFault], of: tuple[OtherSensors, ...], duration: float) -> None:
        base = load_scenario("line4", [f"duration={duration}", "load_changes=[]"])
        scenario = msgspec.structs.replace(base, sensors=msgspec.structs.replace(base.sensors, of=of))
        schedule = FaultSchedule(seed=1, scenario=scenario, faults=tuple(faults))
        run = FaultyRun(schedule)
        watch = Watch(schedule, run.scene)
        self.told: dict[str, list[Estimate]] = {name: [] for name in scenario.robot_names}
        for block in run:
            watch.check(block)
            for name, outbox in block.outboxes.items():
                if outbox.estimate is not None:
                    self.told[name].append(outbox.estimate)
        self.violations = watch.violations


@pytest.mark.slow
def test_a_team_whose_only_gyro_has_left_says_so_until_it_is_back() -> None:
    of = tuple(OtherSensors(robot=robot, missing="gyro") for robot in ("r2", "r3", "r4"))
    story = Story([Release(robot="r1", start=2.0, end=3.5, notice=5)], of, 6.0)
    assert story.violations == []
    for name, told in story.told.items():
        assert {each.status for each in told if 1.7 < each.time < 1.9} == {"valid"}
        assert told[-1].status == "valid"
        if name != "r1":
            (without,) = [each for each in told if 3.0 < each.time < 3.11][:1]
            assert without.status == "stale"
            assert "no robot that holds the load has a gyro, but one is needed" in without.reasons


@pytest.mark.slow
def test_the_robot_with_the_anchor_may_leave_robots_that_miss_sensors() -> None:
    of = tuple(OtherSensors(robot=f"r{k}", missing=sensor) for k, sensor in enumerate(COLUMNS, 2))
    story = Story([Release(robot="r1", start=2.0, end=3.5, notice=5)], of, 6.0)
    assert story.violations == []
    assert {told[-1].status for told in story.told.values()} == {"valid"}
    assert {each.status for each in story.told["r3"] if 2.8 < each.time < 3.4} == {"valid"}


@pytest.mark.slow
def test_six_unlike_robots_find_all_ten_parameters_and_all_poses_within_two_seconds() -> None:
    scenario = load_scenario("mixed6", ["duration=2", "load_changes=[]"])
    assert {missing for own in scenario.robot_sensors() for missing in own.missing} == set(COLUMNS)
    for estimate in last_estimates(scenario).values():
        assert estimate.status == "valid"
        assert len(estimate.poses) == 2  # of its neighbours
        assert estimate.payload is not None
        assert estimate.payload.tensor is not None
        assert abs(estimate.payload.mass - 10.0) < 5.0 * estimate.payload.covariance[0, 0] ** 0.5


@pytest.mark.slow
@EACH
def test_a_fault_of_a_sensor_that_is_missing_is_none(missing: str) -> None:
    fault = SensorFault(start=1.5, end=2.0, robot="r2", sensor=missing, how="offset", size=50.0)
    story = Story([fault], (OtherSensors(robot="r2", missing=missing),), 2.5)
    assert story.violations == []
    assert {each.status for told in story.told.values() for each in told if each.time > 1.3} == {"valid"}
