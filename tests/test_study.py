from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from coheft.app.cli.base import EXIT_USAGE
from coheft.app.cli.main import run_command_line
from coheft.app.results.quantities import QUANTITIES, TeamArrays, directed_edges
from coheft.app.run.inprocess import run_in_process
from coheft.app.study.bounds import ExactRun
from coheft.app.study.campaign import Plan, make_plan, run_study
from coheft.app.study.output import print_study, write_folder
from coheft.app.study.report import StudyReport, summarise
from coheft.app.study.samples import simulate, with_exact_sensors
from coheft.app.study.tables import LEGEND, sentences
from coheft.app.study.trial import Trial, run_trial
from coheft.errors import ScenarioError
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.schema import LoadChange, Scenario
from tests.physics_run import scenario

NAMES = [quantity.name for quantity in QUANTITIES]


def short_ring3() -> Scenario:
    """Three robots, and a load that changes after six seconds."""
    change = LoadChange(at=6.0, mass=2.0, position=(-0.1, 0.15, 0.07))
    return scenario(noise_scale=1.0, rate=500, block=10, load_changes=(change,))


def plan(runs: int = 2, **keys: object) -> Plan:
    return make_plan(short_ring3(), **{"runs": runs, "estimators": ["efficient"], "at": [6.0], **keys})


@pytest.fixture(scope="module")
def studied() -> tuple[StudyReport, list[Trial]]:
    return run_study(plan(), jobs=2)


def numbers(value: object) -> Iterator[object]:
    if isinstance(value, dict):
        for inner in value.values():
            yield from numbers(inner)
    else:
        yield value


def test_report_is_complete(studied: tuple[StudyReport, list[Trial]]) -> None:
    report = json.loads(msgspec.json.encode(studied[0]))
    result = report["results"]["efficient"]
    for name in NAMES:
        assert set(result[name]) == {
            *("rms", "bound_full", "bound_two_step", "ratio_full", "ratio_full_low", "ratio_full_high"),
            *("ratio_two_step", "nees", "nees_low", "nees_high", "missing"),
        }
        found = result[name]
        assert 0.0 < found["bound_full"] <= found["bound_two_step"]
        assert found["ratio_full_low"] <= found["ratio_full"] <= found["ratio_full_high"]
        assert found["ratio_full"] == pytest.approx(found["rms"] / found["bound_full"])
        assert found["ratio_two_step"] == pytest.approx(found["rms"] / found["bound_two_step"])
        assert found["nees_low"] < 1.0 < found["nees_high"]
    assert set(result["all_ten"]) == {"nees", "nees_low", "nees_high"}
    assert result["cells"]["count"] == len(NAMES) + 1
    assert result["claimed"]["count"] == 2 * (3 + 6), "of each run three payloads, six poses"
    assert result["converged"] == 1.0
    assert report["cells"] == [{"noise_scale": 1.0, "at_s": 6.0, "results": report["results"]}]
    assert {"delay_s", "missed", "false_alarms_per_hour"} <= set(result["detection"])
    assert result["recovery"]["seconds_after"] == 1.0
    assert set(result["recovery"]) == {"seconds_after", "mass", "com", "inertia"}
    assert result["impossible_payloads"] == 0
    assert all(math.isfinite(value) for value in numbers(result) if not isinstance(value, str))


def test_estimates_that_are_further_off_than_they_claim_are_counted_and_named(
    studied: tuple[StudyReport, list[Trial]],
) -> None:
    _, trials = studied

    def told(wanted: float) -> str:
        """What is said where r1's mass of the first run is off by so many of its own standard deviations."""
        outcome = trials[0].outcomes["efficient"]
        payload = outcome.errors[0].payload.copy()
        payload[0, 0] = wanted * np.sqrt(outcome.errors[0].covariances.payload[0, 0, 0])
        off = replace(outcome, errors=(replace(outcome.errors[0], payload=payload),))
        group = [replace(trials[0], outcomes={"efficient": off}), *trials[1:]]
        return " ".join(sentences("efficient", summarise([group], plan().moments, [0])["efficient"]))

    assert "efficient: no estimate is off by more than 4 own std." in told(3.9)
    valid = sum(trial.outcomes["efficient"].valid_numbers for trial in trials)
    # Of two runs of 7 s, in nearly all of which three robots know ten numbers of the load and twelve of poses.
    assert 0.5 < valid / (2 * 70 * 3 * 22) < 1.2
    assert f"efficient: 0 of {valid:,} numbers of valid estimates are off by more than 5 own std." in told(3.9)
    assert "efficient: 1 of 18 estimates are further off than they claim, by up to 4.1 own std (up to 4" in told(4.1)


def test_numbers_of_valid_estimates_beyond_five_std_are_counted_all_the_time(
    studied: tuple[StudyReport, list[Trial]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("coheft.app.study.trial.VALID_STDS", 1.0)
    trial = run_trial(short_ring3(), ["efficient"], plan().moments).outcomes["efficient"]
    assert 0.02 < trial.beyond_five / trial.valid_numbers < 0.9, "a third of the numbers of an honest estimate"


def test_errors_are_of_the_bound_s_size(studied: tuple[StudyReport, list[Trial]]) -> None:
    # Two short runs only: this catches wrong units, frames or truths, not lost efficiency.
    for quantity in QUANTITIES:
        accuracy = getattr(studied[0].results["efficient"], quantity.name)
        assert 0.2 < accuracy.ratio_full < 2.5, quantity.name
        assert 0.02 < accuracy.nees < 20.0, quantity.name


def test_what_robots_claim_is_hardly_more_than_the_bound(studied: tuple[StudyReport, list[Trial]]) -> None:
    # Claims hardly depend on the noise that was drawn: two short runs are enough.
    for trial in studied[1]:
        (claimed,) = trial.outcomes["efficient"].errors
        for quantity in QUANTITIES:
            bounds = quantity.expected_squares(trial.full[0].of(quantity))
            ratios = quantity.expected_squares(claimed.covariances.of(quantity)) / bounds
            assert ((ratios > 0.95) & (ratios < 1.5)).all(), f"{quantity.name}: {ratios}"


def test_fan2017_claims_no_less_than_the_bound() -> None:
    _, (trial, *_) = run_study(plan(runs=1, estimators=["fan2017"]), jobs=1)
    (claimed,) = trial.outcomes["fan2017"].errors
    for quantity in QUANTITIES:
        bounds = quantity.expected_squares(trial.two_step[0].of(quantity))
        ratios = quantity.expected_squares(claimed.covariances.of(quantity)) / bounds
        assert ((ratios > 1.0) & (ratios < 30.0)).all(), f"{quantity.name}: {ratios}"


def test_a_second_after_a_change_the_new_load_is_known_as_well_as_it_can_be(
    studied: tuple[StudyReport, list[Trial]],
) -> None:
    recovery = studied[0].results["efficient"].recovery
    assert recovery is not None
    for name in ("mass", "com", "inertia"):
        recovered = getattr(recovery, name)
        assert recovered.missing == 0
        assert 0.02 < recovered.ratio_full < 2.5, name


def assert_same(trial: Trial, other: Trial) -> None:
    ours, theirs = trial.outcomes["efficient"], other.outcomes["efficient"]
    np.testing.assert_array_equal(ours.errors[0].payload, theirs.errors[0].payload)
    np.testing.assert_array_equal(ours.errors[0].covariances.poses, theirs.errors[0].covariances.poses)
    np.testing.assert_array_equal(trial.full[0].payload, other.full[0].payload)


def test_number_of_processes_changes_nothing(studied: tuple[StudyReport, list[Trial]]) -> None:
    _, alone = run_study(plan(runs=1), jobs=1)
    assert_same(alone[0], studied[1][0])


def test_folder_holds_report_and_pictures(studied: tuple[StudyReport, list[Trial]], tmp_path: Path) -> None:
    write_folder(*studied, tmp_path)
    text = (tmp_path / "report.md").read_text()
    for picture in ("ratios.png", "curves.png"):
        assert f"]({picture})" in text
        assert (tmp_path / picture).read_bytes().startswith(b"\x89PNG")
    assert msgspec.json.decode((tmp_path / "report.json").read_bytes(), type=StudyReport) == studied[0]


def test_terminal_shows_tables_and_what_their_columns_mean(studied: tuple[StudyReport, list[Trial]]) -> None:
    output = io.StringIO()
    print_study(Console(file=output, width=80), studied[0])
    text = output.getvalue()
    for part in ("NEES / two-step", "NEES: ", "* outside", "/ two-step: ", "(…): 95 % range"):
        assert part in text
    assert all(f"{line}\n" in text for line in LEGEND), "each on one line"


def test_samples_are_those_that_the_agents_of_a_run_get() -> None:
    run = msgspec.structs.replace(short_ring3(), duration=1.0)
    simulated = simulate(run)
    for ours, record in zip(simulated.truths, run_in_process(run), strict=True):
        np.testing.assert_array_equal(ours.total_wrench, record.truth.total_wrench)
        np.testing.assert_array_equal(ours.samples, record.truth.samples)


def test_bound_is_integrated_well_enough_and_grows_with_the_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    run = msgspec.structs.replace(load_scenario("ring3"), load_changes=(), duration=2.0)
    exact = simulate(with_exact_sensors(run))
    edges = directed_edges(exact.scene.neighbours)

    def bounds_of(run: Scenario) -> TeamArrays:
        chosen = ExactRun(run, exact, edges)
        return chosen.seen(chosen.information(0, run.blocks).full_bound())

    noisy = msgspec.structs.replace(run, sensors=msgspec.structs.replace(run.sensors, noise_scale=3.0))
    bounds, louder = bounds_of(run), bounds_of(noisy)
    monkeypatch.setattr("coheft.app.study.bounds._BOUND_RATE", run.sensors.rate)
    every_sample = bounds_of(run)
    for quantity in QUANTITIES:
        squares = quantity.expected_squares(bounds.of(quantity))
        np.testing.assert_allclose(squares, quantity.expected_squares(every_sample.of(quantity)), rtol=2e-2)
        np.testing.assert_allclose(9.0 * squares, quantity.expected_squares(louder.of(quantity)), rtol=1e-3)


def test_what_was_never_published_is_missing_not_wrong() -> None:
    report, _ = run_study(make_plan(short_ring3(), runs=1, estimators=["fan2017"], at=[0.5]), jobs=1)
    result = report.results["fan2017"]
    assert (result.mass.rms, result.mass.ratio_full, result.mass.nees, result.mass.missing) == (None, None, None, 3)
    assert (result.pose_rotation.rms, result.pose_rotation.missing) == (None, 6)


def test_noise_scales_multiply_the_scenario_s_own_and_seeds_count_on() -> None:
    planned = plan(runs=2, noise_scales=[1.0, 3.0], first_seed=7)
    scenarios = [(factor, s.sensors.noise_scale, s.seed) for factor, s in planned.scenarios()]
    assert scenarios == [(1.0, 1.0, 7), (1.0, 1.0, 8), (3.0, 3.0, 7), (3.0, 3.0, 8)]


def test_only_the_first_change_is_recovered_from() -> None:
    """A second one while that is judged would be taken for a part of it."""
    chosen = short_ring3()
    (first,) = chosen.load_changes
    later = LoadChange(at=6.5, remove=1)
    twice = msgspec.structs.replace(chosen, load_changes=(later, first))
    planned = make_plan(twice, runs=1, estimators=["efficient"], at=[6.0])
    assert [scenario.load_changes for _, scenario in planned.scenarios()] == [(first,)]


def test_accuracy_after_the_load_s_change_is_refused() -> None:
    with pytest.raises(ScenarioError, match="the load changes at 6 s, but accuracy is evaluated at 7 s"):
        plan(at=[2.0, 7.0])


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["--noise", "1,0"], "different positive numbers"),
        (["--noise", "loud"], "different positive numbers"),
        (["--estimators", "fan2017,best"], "different ones of efficient, fan2017"),
        (["--estimators", "seed,eficient"], "found 'seed,eficient'. Did you mean 'efficient'? See"),
        (["--estimators", "fan2017,fan2017"], "different ones of efficient, fan2017"),
        (["--runs", "0"], "--runs"),
        (["--at", "2,25"], "the load changes at 20 s"),
        (["--at", "soon"], "different positive numbers"),
        (["--sensor-rate", "300"], "expected one of 100, 125, 200, 250, 500, 1000; found 300"),
        (["--sensor-rate", "125"], "--sensor-rate 125 makes 2.5 samples of a block of 0.02 s"),
        (["--noise", "0.0001,1"], "expected at least"),
        (["--noise", "inf"], "different positive numbers"),
        (["--jobs", "2", "--dask", "tcp://127.0.0.1:1"], "--jobs is for processes on this machine"),
        (["--json", "/nowhere/study.json"], "there is no folder"),
    ],
)
def test_bad_requests_are_refused_before_anything_runs(
    arguments: list[str], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["study", "ring3", *arguments]) == EXIT_USAGE
    shown = capsys.readouterr()
    assert expected in " ".join((shown.out + shown.err).replace("│", " ").split())


def test_dask_s_workers_give_the_same_numbers(studied: tuple[StudyReport, list[Trial]]) -> None:
    from distributed import LocalCluster

    settings = {"protocol": "tcp", "host": "127.0.0.1", "dashboard_address": None}
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=False, **settings) as cluster:
        _, trials = run_study(plan(runs=1), dask=cluster.scheduler_address)
    assert_same(trials[0], studied[1][0])


def test_times_and_noises_are_judged_apart_and_together() -> None:
    report, (trial, *_) = run_study(plan(runs=2, at=[3.0, 1.5], noise_scales=[1.0, 3.0]), jobs=2)
    assert [(cell.noise_scale, cell.at_s) for cell in report.cells] == [(1.0, 1.5), (1.0, 3.0), (3.0, 1.5), (3.0, 3.0)]
    masses = [cell.results["efficient"].mass for cell in report.cells]
    assert masses[0].bound_full > masses[1].bound_full
    assert masses[2].bound_full == pytest.approx(3.0 * masses[0].bound_full, rel=1e-6)
    pooled = report.results["efficient"]
    assert pooled.cells.count == 4 * (len(NAMES) + 1)
    assert pooled.mass.nees == pytest.approx(np.mean([mass.nees for mass in masses]))
    assert min(mass.ratio_full for mass in masses) < pooled.mass.ratio_full < max(mass.ratio_full for mass in masses)
    output = io.StringIO()
    print_study(Console(file=output, width=80), report)
    assert "noise × 3, at 1.5 s" in output.getvalue()
    assert "of 24, outside 99.99 %" in " ".join(output.getvalue().split())
    # Information of two stretches adds up to that of both.
    alone = run_study(plan(runs=1, at=[3.0]), jobs=1)[1][0]
    np.testing.assert_allclose(trial.full[1].payload, alone.full[0].payload, rtol=1e-6)


def test_another_rate_of_sensors_leaves_blocks_as_long_as_they_are() -> None:
    (_, faster), *_ = plan(runs=1, sensor_rate=1000).scenarios()
    assert (faster.sensors.rate, faster.sensors.block) == (1000, 20)


def test_every_run_of_random_teams_has_its_own() -> None:
    planned = make_plan(None, runs=12, estimators=["efficient"], at=[1.0])
    teams = [scenario for _, scenario in planned.scenarios()]
    assert len({team.robot_count for team in teams}) > 4
    assert [team.seed for team in teams] == list(range(1, 13))
    report, _ = run_study(make_plan(None, runs=2, estimators=["efficient"], at=[1.0]), jobs=2)
    assert report.scenario == "random"
    assert report.results["efficient"].mass.missing == 0


def test_values_of_a_key_are_compared_in_one_table(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "varied.json"
    values = ["--set", "load_changes=[]", "--vary", "sensors.rate=100,200"]
    rest = ["--estimators", "efficient", "--runs", "1", "--at", "1", "--jobs", "1", "--json", str(target)]
    assert run_command_line(["study", "ring3", *values, *rest]) == 0
    variants = json.loads(target.read_text())["variants"]
    assert [each["set"] for each in variants] == ["sensors.rate=100", "sensors.rate=200"]
    bounds = [each["study"]["results"]["efficient"]["mass"]["bound_full"] for each in variants]
    assert bounds[0] == pytest.approx(math.sqrt(2.0) * bounds[1], rel=0.1), "half as many samples tell half as much"
    out = capfd.readouterr().out
    assert "by sensors.rate" in out
    assert f"{variants[1]['study']['results']['efficient']['mass']['rms']:#.3g}" in out


@pytest.mark.parametrize("text", ["sensors.rate", "sensors.rate=100", "sensors.rate=100,100", "=1,2", "a=1,,2"])
def test_what_does_not_vary_is_refused(text: str, capfd: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["study", "ring3", "--vary", text]) == EXIT_USAGE
    assert f"--vary {text}: expected a key and different values" in capfd.readouterr().err


def test_several_studies_are_not_drawn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["study", "ring3", "--vary", "sensors.rate=100,200", "--report", str(tmp_path / "report")]
    assert run_command_line(arguments) == EXIT_USAGE
    assert "--json contains all" in capfd.readouterr().err
