"""Tables in windows of any width: every value is there, and no line is longer than the window."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import pytest
from rich.console import Console
from rich.table import Table

from coheft.app.results.report import Report
from coheft.app.terminal import wide_table
from coheft.app.terminal.final_table import headings, print_report, robot_rows
from coheft.app.terminal.wide_table import print_table
from tests.synthetic_run import HEAVY, SCENE, built_report, estimate, recorded, truth

WIDTHS = (24, 40, 59, 64, 65, 74, 75, 80, 200)
HEADERS = ("test", "mass off after 10 s, kg", "centre of mass off", "own std")
ROW = ("12", "0.001", "not known along the cart", "0.77 %")


def printed(width: int, *, is_terminal: bool, no_wrap: bool = False, rows: Sequence[tuple[str, ...]] = (ROW,)) -> str:
    table = Table(title="Largest errors", title_justify="left")
    for header in HEADERS:
        table.add_column(header, no_wrap=no_wrap)
    for row in rows:
        table.add_row(*row)
    out = io.StringIO()
    print_table(Console(file=out, width=width, force_terminal=is_terminal, color_system=None), table)
    return out.getvalue()


@pytest.fixture(scope="module")
def report() -> Report:
    last = {name: [estimate(name, 9, HEAVY)] for name in SCENE.robots}
    return built_report(recorded([truth(9, HEAVY)], last))


@pytest.mark.parametrize("width", WIDTHS)
def test_the_final_table_is_complete_in_any_window(report: Report, width: int) -> None:
    out = io.StringIO()
    print_report(Console(file=out, width=width, force_terminal=True, color_system=None), report, Path("logs"))
    text, _, path = out.getvalue().partition("Logs of all processes: ")
    assert path == "logs\n"
    assert "…" not in text
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    words = text.split()
    for word in " ".join(headings(report)).split():
        assert any(each.strip(":") == word for each in words)
    for name, robot in report.robots.items():
        for row in robot_rows(robot):
            for word in " ".join((name, *row)).split():
                assert word in words


@pytest.mark.parametrize("no_wrap", [False, True])
@pytest.mark.parametrize("width", range(12, 100))
def test_no_word_is_cut_or_broken_and_no_line_is_longer_than_the_window(width: int, no_wrap: bool) -> None:
    text = printed(width, is_terminal=True, no_wrap=no_wrap)
    assert max(len(line.rstrip()) for line in text.splitlines()) <= width
    words = {word.strip(":│┃") for word in text.split()}
    assert set(" ".join((*HEADERS, *ROW)).split()) <= words


@pytest.mark.parametrize("no_wrap", [False, True])
def test_where_there_is_no_window_the_table_is_as_wide_as_it_has_to_be(no_wrap: bool) -> None:
    text = printed(20, is_terminal=False, no_wrap=no_wrap)
    assert "│ 12 " in text
    assert set(" ".join((*HEADERS, *ROW)).split()) <= set(text.replace("┃", " ").replace("│", " ").split())


def test_in_a_window_that_is_too_narrow_each_value_has_a_line() -> None:
    rows = [ROW, ("", "0.002", "smaller", "")]
    assert printed(44, is_terminal=True, no_wrap=True, rows=rows).splitlines() == [
        "Largest errors",
        "test: 12",
        "mass off after 10 s, kg: 0.001",
        "centre of mass off: not known along the cart",
        "own std: 0.77 %",
        "",
        "mass off after 10 s, kg: 0.002",
        "centre of mass off: smaller",
        "",
    ]


def test_all_modules_print_their_tables_in_this_way() -> None:
    """But for the picture of a run that goes on, which has a way of its own."""
    app = Path(wide_table.__file__).parents[1]
    sources = {path.relative_to(app).as_posix(): path.read_text(encoding="utf-8") for path in app.rglob("*.py")}
    with_tables = {name for name, text in sources.items() if "import Table" in text}
    assert {name for name in with_tables if "print_table" not in sources[name]} == {"terminal/screen.py"}
