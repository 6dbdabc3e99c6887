"""No verdict is good above an error that the robot's own standard deviation rules out."""

from __future__ import annotations

import io
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from rich.console import Console

from coheft.app.results.errors import in_stds
from coheft.app.results.judge import Contradiction, Judge, Verdict
from coheft.app.results.report import Report
from coheft.app.terminal.final_table import print_report, sentences
from coheft.app.terminal.screen import LiveDisplay
from coheft.app.view import words
from coheft.estimation.geometry.spatial import Pose
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.structs import Estimate, Validity
from tests.synthetic_run import GRASPS, HEAVY, SCENE, STD, built_report, estimate, recorded, truth


def off_by(stds: float) -> Inertia:
    """As heavy as the truth and so many standard deviations of r1 more, where r1 has the centre of mass."""
    return Inertia(HEAVY.mass + stds * STD[0], HEAVY.com, HEAVY.tensor)


def judged(said: Estimate) -> list[Contradiction]:
    return Judge(SCENE, [truth(9, HEAVY)]).contradictions(said)


def report_of(*said: Estimate) -> Report:
    others = [estimate(name, 9, HEAVY) for name in SCENE.robots if name not in {each.robot for each in said}]
    return built_report(recorded([truth(9, HEAVY)], {each.robot: [each] for each in (*said, *others)}))


def printed(report: Report) -> str:
    console = Console(file=io.StringIO(), width=80)
    print_report(console, report, Path("logs"))
    assert isinstance(console.file, io.StringIO)
    return " ".join(console.file.getvalue().split())


def test_errors_are_counted_in_the_standard_deviations_of_each_number() -> None:
    stds = in_stds(np.array([1.0, -3.0, 1e-15, 0.1]), np.diag([4.0, 1.0, 0.0, 0.0]))
    assert stds.tolist() == [0.5, 3.0, 0.0, np.inf]


def test_an_error_beyond_four_own_standard_deviations_contradicts_a_valid_estimate() -> None:
    assert judged(estimate("r1", 9, off_by(3.9))) == []
    assert judged(estimate("r1", 9, off_by(4.1))) == [Contradiction("mass", pytest.approx(4.1))]
    assert judged(estimate("r1", 9, off_by(-4.1))) == [Contradiction("mass", pytest.approx(4.1))]


def test_an_estimate_that_calls_itself_stale_claims_nothing() -> None:
    wrong = estimate("r1", 9, off_by(9.0))
    assert judged(msgspec.structs.replace(wrong, status=Validity.STALE)) == []


def test_poses_of_neighbours_are_compared_with_their_own_std() -> None:
    shift = GRASPS["r1"].rotation.T @ np.array([0.0, 0.0, 5.0])  # the std of synthetic poses is 1
    moved = Pose(np.eye(3), GRASPS["r2"].rotation.T @ GRASPS["r1"].rotation @ shift)
    found = judged(estimate("r1", 9, HEAVY, pose_error=moved))
    assert [each.quantity for each in found][:1] == ["pose of r2"]
    assert found[0].stds > 4.0
    assert judged(estimate("r1", 9, HEAVY, pose_error=moved, phase="poses")) == []


def test_a_report_is_not_good_above_an_error_that_its_std_rules_out() -> None:
    good, bad = report_of(), report_of(estimate("r2", 9, off_by(12.0)))
    assert good.verdict is Verdict.CONVERGED
    assert "All robots converged" in printed(good)
    assert all(robot.converged for robot in bad.robots.values()), "robots do not know it"
    assert bad.verdict is Verdict.CONTRADICTED
    text = printed(bad)
    assert "converged" not in text
    assert "Further off than they claim: r2 (mass, by 12 own std); up to 4 is normal." in text
    assert re.search(r"r2 mass, kg 13.000 14.200 9.23 % 0.77 % \(12×\)", text)


def test_of_many_robots_that_are_further_off_than_they_claim_the_worst_are_named() -> None:
    report = report_of(*(estimate(name, 9, off_by(stds)) for name, stds in (("r1", 5.0), ("r2", 7.0), ("r3", 6.0))))
    told = next(text for text in sentences(report) if text.startswith("Further off"))
    assert told.startswith("Further off than they claim: r2 (mass, by 7 own std), r3 (mass, by 6 own std), r1 (mass,")


def test_who_has_not_converged_is_named_beside_who_is_further_off_than_it_claims() -> None:
    report = report_of(estimate("r1", 9, HEAVY, converged=False), estimate("r2", 9, off_by(12.0)))
    text = printed(report)
    assert "Further off than they claim: r2" in text
    assert "Not converged: r1 (all is known" in text


def test_terminal_and_view_do_not_show_it_as_good_while_it_runs() -> None:
    said = estimate("r2", 9, off_by(12.0))
    record = recorded([truth(9, HEAVY)], {"r2": [said]})
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system="standard")
    with LiveDisplay(console) as display:
        display.update(record)
    assert isinstance(console.file, io.StringIO)
    red, green = "\x1b[31m", "\x1b[32m"
    assert f"{red}converged" in console.file.getvalue()
    assert f"{green}converged" not in console.file.getvalue()
    text = words.belief((record.judge.robot(said), said))
    assert "further off than it claims: mass, by 12 own std" in text
