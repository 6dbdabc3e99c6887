"""The command line as people and programs meet it: in a terminal of 80 columns, in a pipe, with a report."""

from __future__ import annotations

import json
import os
import re
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from tests.escapes import COLOUR, SEQUENCE

COHEFT = [sys.executable, "-m", "coheft"]
LIMIT = 110.0

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="terminals as on POSIX"),
    pytest.mark.usefixtures("own_state_folder"),
]


def in_terminal(*arguments: str, columns: int = 80, lines: int = 24, **environment: str) -> tuple[int, str]:
    """Exit status and all that a terminal of that size gets."""
    import fcntl
    import pty
    import termios

    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
    settings = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
    process = subprocess.Popen(
        [*COHEFT, *arguments],
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**settings, "TERM": "xterm-256color", **environment},
    )
    os.close(theirs)
    output = b""
    try:
        while part := os.read(ours, 65536):
            output += part
    except OSError:  # how Linux says that the other end has gone
        pass
    finally:
        os.close(ours)
        try:
            status = process.wait(LIMIT)
        finally:
            process.kill()
    return status, output.decode()


def lines_of(text: str) -> list[str]:
    return re.split(r"[\r\n]+", SEQUENCE.sub("", text))


@pytest.mark.parametrize(
    ("arguments", "status"),
    [(["help"], 0), (["help", "run"], 0), (["scenarios"], 0), (["run", "ring5"], 2), (["inject", "--mass", "3"], 2)],
)
def test_what_is_said_fits_80_columns(arguments: list[str], status: int) -> None:
    ended, text = in_terminal(*arguments)
    assert ended == status, text
    assert text
    assert "Traceback" not in text
    assert max(map(len, lines_of(text))) <= 80


@pytest.mark.parametrize(("asked", "has_colours"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_a_run_fits_80_columns_and_has_no_colours_if_so_asked(asked: dict[str, str], has_colours: bool) -> None:
    status, text = in_terminal("run", "ring3", "--duration", "2", **asked)
    assert status in (0, 3), text
    assert bool(COLOUR.search(text)) == has_colours
    lines = lines_of(text)
    assert max(len(line) for line in lines if "Logs of all processes" not in line) <= 80
    assert any("of 2 s" in line for line in lines)


def test_a_run_in_a_narrow_window_is_told_in_full() -> None:
    status, text = in_terminal("run", "ring3", "--duration", "5", columns=40)
    assert status in (0, 3), text
    assert "robot  state" not in text, "no table that does not fit"
    lines = [line.rstrip() for line in lines_of(text)]
    assert any(re.match(r" +[\d.]+ s of 5 s: ", line) for line in lines)
    for start in ("robot: r3", "quantity: inertia, kg·m²", "truth: ", "estimate: ", "error: ", "own std: "):
        assert any(line.startswith(start) for line in lines), start
    assert max(len(line) for line in lines if "Logs of all processes" not in line) <= 40


def test_a_team_that_is_larger_than_the_window_does_not_scroll_while_it_runs() -> None:
    status, text = in_terminal("run", "ring12", "--duration", "2", lines=9, NO_COLOR="1")
    assert status in (0, 3), text
    running, _, _ = text.partition("What each robot found out")
    pictures = [
        each.splitlines() for each in re.split(r"\r(?!\n)", SEQUENCE.sub("", running)) if "robot  state" in each
    ]
    assert pictures
    assert all(len(picture) <= 9 for picture in pictures)
    assert "and 7 more: " in "".join(pictures[-1]), "as soon as all have said something"


def test_a_run_for_programs_writes_json_alone_to_standard_output_and_a_page_beside(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    folder = tmp_path / "report"
    done = subprocess.run(
        [*COHEFT, "run", "ring3", "--duration", "3", "--json", "-", "--report", str(folder)],
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )
    assert done.returncode in (0, 3), done.stderr
    report = json.loads(done.stdout)
    assert report == json.loads((folder / "report.json").read_text())
    assert "\x1b" not in done.stderr
    assert f"Report: {folder / 'report.html'}" in done.stderr
    page = (folder / "report.html").read_text()
    for robot in report["robots"].values():
        assert f"{robot['mass']['truth']:.3f}" in page
        assert robot["mass"]["estimate"] is None or f"{robot['mass']['estimate']:.3f}" in page
    assert page.count("data:image/png;base64,") == 2 * len(list(folder.glob("*.png")))
