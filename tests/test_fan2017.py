"""The method of Fan et al. as a whole, in one process: how near it gets, on which graphs, and when it says no."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from coheft.agents.agent import Agent
from coheft.agents.fan2017.claims import likeliest_body
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import FaultSchedule, Pause, Release
from coheft.app.results.judge import Judge
from coheft.app.run.inprocess import TeamInProcess, measured, run_in_process
from coheft.estimation.rigid_body.consistency import is_possible
from coheft.estimation.rigid_body.mass_properties import Inertia, unpack_symmetric
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.messages.codec import encode
from coheft.wire.messages.structs import Validity
from coheft.wire.scenario.estimator_settings import Fan2017Settings
from coheft.wire.scenario.file import CONFIG_FOLDER, load_scenario
from coheft.wire.scenario.schema import Graph, Scenario
from tests.in_process import Recording, assert_good, changed, run_with_faults


def fan2017(name: str, **changes: object) -> Scenario:
    return changed(name, estimator="fan2017", **changes)


@pytest.mark.slow
def test_the_paper_s_experiment() -> None:
    """Section VII: poses in several seconds, mass properties in less than ten, and anew after the change."""
    change = load_scenario("fan2017").load_changes[0].at
    recording = run_with_faults(fan2017("fan2017", duration=change + 10.0))
    weighing = [next(e.time for e in each if e.phase == "inertia") for each in recording.estimates.values()]
    assert max(weighing) < 8.0
    for moment in (max(weighing) + 10.0, change + 10.0):
        assert_good(recording.judged(moment), inertia_pct=10.0)
        latest = [[e for e in each if e.time <= moment][-1] for each in recording.estimates.values()]
        assert all(estimate.is_converged and estimate.estimator == "fan2017" for estimate in latest)
        assert {estimate.members for estimate in latest} == {6}
    for estimate in recording.last().values():
        (notice,) = estimate.load_changes
        assert abs(notice.changed_at - change) < 0.1
        assert change < notice.noticed_at < change + 1.0


def test_the_paper_s_experiment_is_what_section_vii_says() -> None:
    scenario = load_scenario("fan2017")
    assert (scenario.estimator, scenario.graph.kind, scenario.robot_count) == ("fan2017", "ring", 6)
    assert len({getattr(scenario.noise, sensor) for sensor in scenario.noise.__struct_fields__}) == 1
    assert scenario.sensors.tolerance == SensorTolerance()
    assert len(scenario.load_changes) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "graph"),
    [
        ("line4", Graph(kind="star")),
        ("line4", Graph(kind="complete")),
        ("ring6", Graph(kind="random", seed=5)),
    ],
    ids=lambda value: value.kind if isinstance(value, Graph) else value,
)
def test_other_graphs(name: str, graph: Graph) -> None:
    duration = 12.0
    recording = run_with_faults(fan2017(name, graph=graph, duration=duration, load_changes=()))
    assert_good(recording.judged(duration))
    for estimate in recording.last().values():
        assert estimate.converged
        assert estimate.load_changes == []


@pytest.mark.slow
def test_what_sums_that_lag_behind_do_is_in_the_standard_deviation() -> None:
    """With 8 rounds, a ring of six keeps 4 % of what robots disagree on, and they push hard against each other."""
    duration, settings = 12.0, Fan2017Settings(rounds=8, extrapolate=False)
    recording = run_with_faults(fan2017("ring6", duration=duration, load_changes=(), fan2017=settings))
    for report in recording.judged(duration).values():
        mass = report.mass
        assert mass.estimate is not None
        assert mass.std is not None
        assert mass.std < 0.005 * mass.truth
        assert abs(mass.estimate - mass.truth) < 1.7 * mass.std


@pytest.mark.slow
def test_around_a_load_change_nothing_valid_is_wrong() -> None:
    """From its first block on, another load is doubted; then old samples count, and pull robots' estimates apart."""
    change = replace(load_scenario("line4").load_changes[0], at=8.0)
    found = run_with_faults(fan2017("line4", seed=3, duration=12.0, load_changes=(change,)))
    judge = Judge(found.scene, found.truths)
    valid = [each for told in found.estimates.values() for each in told if each.status is Validity.VALID]
    assert sum(each.time > 9.0 for each in valid) > 100
    for estimate in valid:
        assert all(stds.max(initial=0.0) < 5.0 for stds in judge.in_stds(estimate).values()), estimate.time


def test_two_robots() -> None:
    line4 = load_scenario("line4")
    robots = type(line4.robots)(grasps=line4.robots.grasps[::3])
    recording = run_with_faults(fan2017("line4", robots=robots, duration=16.0, load_changes=()))
    assert_good(recording.judged(16.0))
    assert all(estimate.converged and estimate.members == 2 for estimate in recording.last().values())


@pytest.mark.slow
def test_a_robot_that_lets_go_leaves_the_team_and_comes_back_with_its_pose_unknown() -> None:
    scenario = fan2017("ring3", duration=24.0, load_changes=())
    release = Release(start=10.0, end=12.0, robot="r2", notice=2)
    run = FaultyRun(FaultSchedule(seed=1, scenario=scenario, faults=(release,)))
    recording = Recording(run.scene, [], {name: [] for name in run.graph})
    for block in run:
        assert block.crashes == {}
        recording.truths.append(block.truth)
        for name, outbox in block.outboxes.items():
            if outbox.estimate is not None:
                recording.estimates[name].append(outbox.estimate)
    during = {name: [e for e in each if e.time < 11.9][-1] for name, each in recording.estimates.items()}
    assert {name: estimate.status for name, estimate in during.items()} == {"r1": "valid", "r2": "stale", "r3": "valid"}
    assert set(during["r1"].poses) == {"r3"}
    after = next(estimate for estimate in recording.estimates["r1"] if estimate.time > 12.5)
    assert after.status == "stale"
    assert_good(recording.judged(24.0))
    assert all(estimate.status == "valid" for estimate in recording.last().values())


def test_both_ends_of_an_edge_find_one_pose_also_after_a_restart() -> None:
    """Else transports around the graph do not cancel, as Proposition 3 demands."""
    team = TeamInProcess(fan2017("ring3", load_changes=()))
    for block in range(160):
        if block == 60:
            agent = team.agents["r2"]
            team.agents["r2"] = Agent(agent.config, incarnation=1)
        team.answer(measured(team.measure()), team.received())
    one, other = (team.agents[i].belief().poses[j].pose for i, j in (("r1", "r2"), ("r2", "r1")))
    np.testing.assert_allclose((one @ other).translation, 0.0, atol=1e-9)


@pytest.fixture(scope="module")
def ring3() -> Recording:
    return run_with_faults(fan2017("ring3", duration=12.0, load_changes=()))


def test_the_total_wrench_is_the_sum_of_all_robots(ring3: Recording) -> None:
    recording = ring3
    truths = {truth.block: truth.total_wrench for truth in recording.truths}
    for name, rotation, translation in zip(
        recording.scene.robots, recording.scene.rotations, recording.scene.translations, strict=True
    ):
        estimate = recording.estimates[name][-1]
        truth = truths[estimate.total_block]
        force = rotation @ estimate.total_wrench[:3]
        torque = rotation @ estimate.total_wrench[3:] + np.cross(translation, force)
        assert np.linalg.norm(force - truth[:3]) < 0.02 * np.linalg.norm(truth[:3])
        assert np.linalg.norm(torque - truth[3:]) < 0.02 * np.linalg.norm(truth[:3])  # about a point 1 m away at most


def test_after_a_missed_block_no_sum_is_used_that_mixes_two() -> None:
    scenario = fan2017("ring3", duration=12.0, load_changes=())
    length, missed = scenario.block_duration, 400
    pause = Pause(start=(missed - 0.5) * length, end=(missed + 0.5) * length, robot="r2")
    totals = {}
    run = FaultyRun(FaultSchedule(seed=1, scenario=scenario, faults=(pause,)))
    for block in run:
        assert run._agents["r2"] is not None
        totals[block.block] = run._agents["r2"]._estimator.belief().total_block
        assert ("r2" in block.outboxes) == (block.block != missed)
    assert totals[missed - 2] + 1 == totals[missed - 1] == totals[missed + 1]
    assert totals[max(totals)] > missed


def test_too_little_motion_ends_with_not_observable_and_no_numbers() -> None:
    recording = run_with_faults(fan2017("quiet", duration=10.0))
    for estimates in recording.estimates.values():
        for estimate in estimates:
            assert estimate.payload is None
            assert not estimate.converged
        assert estimates[-1].phase == "poses"
        assert len(estimates[-1].not_observable) == 2
        assert all("has to turn more" in text for text in estimates[-1].not_observable)


def test_where_sensors_may_be_off_it_says_that_it_does_not_know_them_and_claims_nothing(ring3: Recording) -> None:
    """Real3, whose robots are told so, and the same with exact sensors."""
    real3 = run_with_faults(fan2017("real3", duration=12.0, load_changes=()))
    for recording, is_told in ((real3, True), (ring3, False)):
        for estimates in recording.estimates.values():
            last = estimates[-1]
            assert last.phase == "inertia"
            assert (last.payload is None) == is_told
            assert any("does not model" in text for text in last.reasons) == is_told
            assert any(estimate.status == "valid" for estimate in estimates) != is_told


IN_OTHER_TESTS = ("fan2017", "line4", "quiet", "real3", "ring3", "ring6")
PAYLOADS = sorted(
    path.stem
    for path in CONFIG_FOLDER.glob("*.toml")
    if path.stem not in ("carry6", "cart", "mixed6", *IN_OTHER_TESTS) and load_scenario(path.stem).robot_count <= 12
)


@pytest.mark.slow
@pytest.mark.parametrize("name", PAYLOADS)
def test_every_payload_scenario_runs_with_it(name: str) -> None:
    scenario = fan2017(name, duration=5.0)
    is_exact = scenario.sensors.tolerance == SensorTolerance()
    recording = run_with_faults(scenario)
    assert set(recording.estimates) == set(scenario.robot_names)
    for estimate in recording.last().values():
        assert is_exact or estimate.payload is None
        assert estimate.status != "valid" or estimate.payload is not None
        assert estimate.is_converged or estimate.reasons, "why it has not converged is said"


@pytest.mark.slow
def test_poses_that_are_known_much_better_are_taken_over() -> None:
    """Begun with poses that are off by centimetres, it says that they keep it from converging, and gets past them."""
    settings = Fan2017Settings(pose_rotation_deg=1.0, pose_translation_mm=20.0)
    recording = run_with_faults(fan2017("ring3", duration=14.0, load_changes=(), fan2017=settings))
    for name, estimates in recording.estimates.items():
        first = next(estimate for estimate in estimates if estimate.status == "valid")
        assert not first.converged
        assert any("poses that are frozen" in text for text in first.reasons)
        assert estimates[-1].is_converged, (name, estimates[-1].reasons)
        assert estimates[-1].reasons == []
    assert_good(recording.judged(14.0))


def test_one_scenario_and_seed_give_the_same_estimates_bit_for_bit() -> None:
    scenario = fan2017("ring3", duration=6.0)
    runs = [
        [encode(estimate, "key") for record in run_in_process(scenario) for estimate in record.estimates.values()]
        for _ in range(2)
    ]
    assert runs[0] == runs[1]
    assert len(runs[0]) >= 3 * 60  # ten times a second, and when doubts come or go


def test_messages_of_whole_numbers_are_refused_because_their_products_overflow() -> None:
    """An agent that multiplied them would end with an error."""
    team = TeamInProcess(fan2017("ring3"))
    for _ in range(60):
        result, heard = team.measure(), team.received()
        if heard["r1"]:
            heard["r1"] = [
                replace(message, channels={name: array.astype(np.int64) for name, array in message.channels.items()})
                for message in heard["r1"]
            ]
        outboxes = team.answer(measured(result), heard)
        if heard["r1"] and heard["r1"][0].channels:
            break
    assert "this robot's estimator cannot read its arrays" in outboxes["r1"].problems[0]


@pytest.mark.parametrize("seed", range(20))
def test_a_body_that_cannot_exist_is_corrected_however_unequal_the_units(seed: int) -> None:
    rng = np.random.default_rng(seed)
    raw = Inertia(10.0 ** rng.uniform(1, 4), rng.normal(size=3), unpack_symmetric(rng.normal(size=6)))
    root = rng.normal(size=(10, 10)) * 10.0 ** rng.uniform(-4, -1, size=(10, 1))
    root[0] *= raw.mass**2  # as of 1/m
    assert is_possible(likeliest_body(raw, root @ root.T, 0.5).barycentric(), thinnest=-1e-9)
