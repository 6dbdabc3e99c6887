"""Whose fault it is: named if the recording tells, otherwise all who are about as likely."""

from __future__ import annotations

import pytest

from benchmarks.recording_faults import faulty
from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.app.identify.report import make_report
from coheft.errors import RecordingError


def test_robots_whose_clocks_explain_it_equally_well_are_all_named() -> None:
    case = faulty("wrench clock", 931203, by_twists=False)
    found = identify(case.recording)
    assert found.verdict is not None
    assert found.verdict.cause == "clock"
    assert case.robot in found.verdict.candidates
    assert "all robots" in found.verdict.candidates
    assert "or wrenches of r3 are" in found.verdict.words
    assert "which of these is not known" in found.verdict.words
    report = make_report("x", case.recording, found).verdict
    assert report is not None
    assert (report.robot, tuple(report.candidates)) == (None, found.verdict.candidates)


def test_no_correction_is_chosen_among_those_with_different_loads() -> None:
    case = faulty("scale", 931186, by_twists=True)
    verdict = identify(case.recording).verdict
    assert verdict is not None
    assert verdict.candidates == ("r1", "r2")
    assert verdict.mass is None
    with pytest.raises(RecordingError, match="nothing says whose readings to correct"):
        identify(case.recording, Options(assume="scale"))


@pytest.mark.parametrize("seed", [918200, 931215])
def test_the_home_frame_that_is_tilted_is_named(seed: int) -> None:
    case = faulty("not level", seed, by_twists=False)
    verdict = identify(case.recording).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == ("gravity", case.robot)
    assert f"the home frame of {case.robot} is tilted" in verdict.words


def test_noise_of_one_robots_orientation_is_no_tilt_of_all_homes() -> None:
    verdict = identify(faulty("scale", 931025, by_twists=False).recording).verdict
    assert verdict is not None
    assert verdict.cause != "gravity"


@pytest.mark.parametrize(
    ("kind", "seed", "cause"), [("compensated", 955131, "weight compensated"), ("dead", 955147, "sensor dead")]
)
def test_what_explains_everything_is_named_before_what_explains_much(kind: str, seed: int, cause: str) -> None:
    case = faulty(kind, seed, by_twists=False)
    verdict = identify(case.recording).verdict
    assert verdict is not None
    assert (verdict.cause, verdict.robot) == (cause, case.robot)


def test_a_load_that_may_have_no_mass_is_no_explanation() -> None:
    verdict = identify(faulty("load change", 931157, by_twists=False).recording).verdict
    assert verdict is not None
    assert verdict.cause == "load change"
