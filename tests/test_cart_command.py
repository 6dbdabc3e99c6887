"""The command ``coheft cart``."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from coheft.app.cart.judge import CartReport
from coheft.app.cart.table import missed, rows, sentences
from coheft.app.cart.table_one import QUIET_TESTS, TESTS, table_one
from coheft.app.cli.base import EXIT_USAGE
from coheft.app.cli.main import run_command_line

GOOD = CartReport(
    test=1,
    seed=1,
    pushers=1,
    learns=True,
    mass_error_kg=0.01,
    mass_std_kg=0.01,
    com_error_mm=80.0,
    com_known=False,
    com_std_mm=90.0,
    inertia_error_kg_m2=0.1,
    not_known=["d_x"],
    largest_tracking_error_m=0.012,
    first_tracking_error_m=0.02,
    mean_effort_n=10.0,
    slip_m_s=1e-7,
    jumps=0,
    doubts=[],
    loads=[],
    diverged=False,
)


def changed(**fields: object) -> CartReport:
    from msgspec.structs import replace

    return replace(GOOD, **fields)


@pytest.mark.slow
def test_a_test_of_table_one_beats_the_papers_claims(tmp_path: Path) -> None:
    report, figures = tmp_path / "report.json", tmp_path / "figures"
    arguments = [
        "cart",
        "--test",
        "8",
        "--jobs",
        "1",
        "--quiet",
        "--json",
        str(report),
        "--figures",
        str(figures),
    ]
    assert run_command_line(arguments) == 0
    found = json.loads(report.read_text())
    assert found["missed"] == []
    learned, fixed = found["reports"]
    assert abs(learned["mass_error_kg"]) < 0.1
    assert learned["largest_tracking_error_m"] < 0.03
    assert fixed["learns"] is False
    assert fixed["largest_tracking_error_m"] > 0.2
    assert sorted(path.name for path in figures.iterdir()) == ["fig4-tracking.png", "fig5-mass.png"]


@pytest.mark.parametrize(
    "arguments", [["--test", "0"], ["--test", "13"], ["--pushers", "0"], ["--friction-guess", "0"]]
)
def test_wrong_usage_is_told(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line(["cart", *arguments]) == EXIT_USAGE
    assert arguments[0] in capsys.readouterr().err + capsys.readouterr().out


@pytest.mark.parametrize(
    ("report", "words"),
    [
        (GOOD, []),
        (changed(mass_error_kg=-0.2), ["mass off by -0.20 kg"]),
        (changed(test=10, mass_error_kg=-0.2), []),
        (changed(com_known=True, com_error_mm=11.0), ["11.0 mm, but said to be known"]),
        (changed(largest_tracking_error_m=0.04), ["4.0 cm off the path"]),
        (changed(diverged=True), ["diverged"]),
        (changed(learns=False, largest_tracking_error_m=0.1), ["10.0 cm only"]),
        (changed(test=12, mass_error_kg=5.0), []),
    ],
)
def test_what_is_worse_than_it_should_be_is_told(report: CartReport, words: list[str]) -> None:
    found = missed([report])
    assert len(found) == len(words)
    assert all(word in text for word, text in zip(words, found, strict=True))


def test_the_table_shows_the_worst_run_of_each_test() -> None:
    reports = [GOOD, changed(seed=2, mass_error_kg=-0.03), changed(learns=False, largest_tracking_error_m=0.27)]
    assert rows(reports) == [("1", "0.030", "not known along the cart", "1.2", "27")]
    assert sentences(reports) == [
        "Where the centre of mass is along the cart only curves show; across it, speeding up or slowing down.",
        "0 of 2 runs diverged.",
    ]


def test_what_is_known_in_some_runs_only_is_said_beside_the_worst_of_these() -> None:
    known, unknown = changed(com_known=True, com_error_mm=0.25), changed(seed=2, not_known=["mass", "d_y", "d_x"])
    assert rows([known, unknown])[0][2] == "0.2 not known along and across the cart"


def test_table_one_is_the_papers() -> None:
    """Initial mass, CoM and noise of some rows, as printed."""
    assert tuple(range(1, 12)) == TESTS
    assert tuple(range(1, 9)) == QUIET_TESTS
    assert table_one(2).guess.mass == 24.0
    assert table_one(6).cart.com == (0.3, -0.15)
    assert table_one(10).noise == 0.2
    assert {test for test in TESTS if table_one(test).trajectory == "straight"} == {1, 2, 3}
    assert {test for test in TESTS if table_one(test).slides} == {3, 6, 7, 9, 10, 11}
    assert {table_one(test).cart.mass for test in TESTS} == {20.0}
