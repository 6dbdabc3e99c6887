"""The final table of a run, and its sentences."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from coheft.app.results.judge import Verdict
from coheft.app.results.report import build_report
from coheft.app.terminal.digits import error_and_std
from coheft.app.terminal.final_table import print_report, robot_rows, sentences
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.structs import Estimate
from tests.synthetic_run import (
    GRASPS,
    HEAVY,
    LIGHT,
    SCENARIO,
    SCENE,
    built_report,
    changing_run,
    estimate,
    recorded,
    truth,
)
from tests.test_terminal import drawn, stale, terminal


def test_the_final_table_says_why_a_run_has_not_converged() -> None:
    truths = [truth(block, HEAVY) for block in range(10)]
    last = {"r1": estimate("r1", 9, HEAVY), "r2": estimate("r2", 9, HEAVY), "r3": stale("r3", 9, "r2 is silent")}
    report = built_report(recorded(truths, {name: [each] for name, each in last.items()}))
    assert report.verdict is Verdict.NOT_CONVERGED
    assert report.robots["r3"].reasons == ["r2 is silent"]
    console = terminal(is_terminal=False)
    print_report(console, report, Path("logs"))
    assert "What each robot found out about the payload (0.2 s, fan2017)" in drawn(console)
    assert "Stale at r3: r2 is silent.\nNot converged: r3 (stale).\n" in drawn(console)
    assert max(map(len, drawn(console).splitlines())) <= 80


def test_lines_below_the_table_break_at_its_width_only() -> None:
    report = built_report(recorded([truth(9, HEAVY)], {name: [estimate(name, 9, HEAVY)] for name in GRASPS}))
    console = terminal(is_terminal=False)
    print_report(console, report, Path("logs"))
    begin = (
        drawn(console)
        .splitlines()
        .index("Centre of mass: x y z in the robot's grasp frame. Inertia: principal moments.")
    )
    legend = drawn(console).splitlines()[begin : begin + 4]
    assert all(len(line) > 40 for line in legend[:3]), legend


def test_the_speed_of_a_run_is_told_only_where_it_is_known() -> None:
    record = recorded([truth(9, HEAVY)], {name: [estimate(name, 9, HEAVY)] for name in GRASPS})
    known, unknown = built_report(record), build_report(SCENARIO, record)
    assert any("real time" in text for text in sentences(known))
    assert not any("real time" in text for text in sentences(unknown)), "a recording does not tell"


def test_the_final_table_gives_one_example_of_what_is_not_observable() -> None:
    beliefs = {name: estimate(name, 9, None, converged=False) for name in ("r1", "r2", "r3")}
    beliefs["r3"] = msgspec.structs.replace(beliefs["r3"], not_observable=["pose of r2: move"])
    report = built_report(recorded([truth(9, HEAVY)], {name: [each] for name, each in beliefs.items()}))
    console = terminal(is_terminal=False)
    print_report(console, report, Path("logs"))
    text = " ".join(drawn(console).split())
    assert "Not observable for r1: mass: too little motion. And 1 more;" in text
    assert "lists them all. Not observable for r3: pose of r2: move. Not converged" in text


def test_the_final_table_tells_of_load_changes() -> None:
    truths, estimates = changing_run({"r1": 110, "r2": 120, "r3": 115}, {"r1": 2.06, "r2": 2.04, "r3": 2.1})
    console = terminal(is_terminal=False)
    print_report(console, built_report(recorded(truths, estimates)), Path("logs"))
    text = " ".join(drawn(console).split())
    assert "At 2 s the payload changed from 10.00 kg to 13.00 kg. The last robot noticed after 0.1 s." in text
    assert "All recovered after 0.4 s." in text


def test_what_could_not_be_noticed_or_recovered_is_not_held_against_the_robots() -> None:
    truths, estimates = changing_run(dict.fromkeys(("r1", "r2", "r3"), 10**6), {"r1": 2.06})
    unknowing = {name: [estimate(name, each.block, None) for each in series] for name, series in estimates.items()}
    again = [truth(each.block, LIGHT) if each.block >= 150 else each for each in truths]
    missed, unknown, twice = (
        [text for text in sentences(built_report(recorded(*run))) if "the payload changed" in text]
        for run in ((truths, estimates), (truths, unknowing), (again, estimates))
    )
    only = "r1 noticed after 0.1 s; r2, r3 did not notice."
    assert [text.partition("kg. ")[2] for text in missed] == [f"{only} Not all recovered."]
    nothing = "No robot knew the load yet, so there was nothing to notice."
    assert [text.partition("kg. ")[2] for text in unknown] == [f"{nothing} Not all recovered."]
    assert [text.partition("kg. ")[2] for text in twice] == [
        f"{only} The load changed again before all recovered.",
        "No robot noticed. All recovered after 0.0 s.",
    ]


def test_error_and_own_std_are_in_one_unit_and_have_the_same_decimals() -> None:
    believed = {"r1": Inertia(13.004, HEAVY.com, 1.001 * HEAVY.tensor), "r2": HEAVY, "r3": HEAVY}
    last = {name: [estimate(name, 9, payload)] for name, payload in believed.items()}
    report = built_report(recorded([truth(9, HEAVY)], last))
    mass, com, inertia = robot_rows(report.robots["r1"])
    assert mass == ("mass, kg", "13.000", "13.004", "0.03 %", "0.77 %")  # std 0.1 kg
    assert com[3:] == ("0.0 mm", "3.7 mm")
    assert inertia[3:] == ("0.1 %", "7.5 %")


@pytest.mark.parametrize(
    ("error", "std", "expected"),
    [
        (0.0004, 0.00113, ("0.0004 %", "0.0011 %")),
        (31.4, 0.00113, ("31.4000 %", "0.0011 %")),
        (0.4, 113.0, ("0 %", "113 %")),
        (2e-9, 1.13e-8, ("2.0e-09 %", "1.1e-08 %")),
        (0.0, 0.0, ("0 %", "0 %")),
    ],
)
def test_a_std_is_never_rounded_to_nothing(error: float, std: float, expected: tuple[str, str]) -> None:
    assert error_and_std(error, std, "%") == expected


def test_small_payloads_show_digits_and_nothing_is_minus_zero() -> None:
    principal = np.diag([0.00004, 0.0012, 0.0012])
    small = Inertia(0.05, np.zeros(3), principal).transported(GRASPS["r1"])
    off = Inertia(0.05, np.array([-1e-5, 0.0, 0.0]), principal).transported(GRASPS["r1"])
    last = {name: [estimate(name, 9, off)] for name in SCENE.robots}
    mass, com, inertia = robot_rows(built_report(recorded([truth(9, small)], last)).robots["r1"])
    assert mass[1] == "0.05000"
    assert com[1:3] == ("0 0 0", "0 0 0")
    assert inertia[1] == "0.0000 0.0012 0.0012"


def test_a_machine_that_is_too_slow_for_real_time_gets_advice() -> None:
    report = built_report(recorded([truth(9, HEAVY)], {name: [estimate(name, 9, HEAVY)] for name in SCENE.robots}))
    said = [" ".join(sentences(msgspec.structs.replace(report, late_blocks=count))) for count in (0, 1, 1800)]
    assert "too late" not in said[0]
    assert "Once a robot answered too late" in said[1]
    assert "1,800 times a robot answered too late: this machine was too slow for real time. Leave out" in said[2]


def final_sentence(*last: Estimate) -> str:
    console = terminal(is_terminal=False)
    report = built_report(recorded([truth(9, HEAVY)], {each.robot: [each] for each in last}))
    print_report(console, report, Path("logs"))
    return " ".join(drawn(console).split())


def test_the_final_table_says_what_those_who_have_not_converged_lack() -> None:
    done = estimate("r1", 9, HEAVY), estimate("r2", 9, HEAVY)
    unknown = msgspec.structs.replace(estimate("r3", 9, None, converged=False), not_observable=[])
    text = final_sentence(*done, unknown)
    assert "mass, kg 13.000 not known" in text
    assert "Not converged: r3 (the mass is still being found). --duration gives more time." in text
    text = final_sentence(*done, estimate("r3", 9, HEAVY, converged=False))
    assert "Not converged: r3 (all is known, but its std is not yet as small as [converged] in the scenario" in text
    finding = msgspec.structs.replace(unknown, phase="poses")
    text = final_sentence(done[0], msgspec.structs.replace(finding, robot="r2"), finding)
    assert "Not converged: r2, r3 (the poses of neighbours are still being found). --duration" in text
    assert "std is not as small" not in text
    unobservable = msgspec.structs.replace(unknown, not_observable=["mass: move"])
    text = final_sentence(*done, unobservable)
    assert "mass, kg 13.000 not observable" in text
    assert "Not converged: r3 (not everything is observable). 0.2 s simulated" in text
