"""The view as people meet it: real runs, in a real browser without a window."""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from coheft.app.run.folder import RUN_FILE, RunFile, find_run
from coheft.app.run.observer import ask_server
from coheft.app.view import words
from coheft.errors import CoheftError
from coheft.wire.messages.requests import Status, StatusRequest, StopRequest
from coheft.wire.scenario.schema import MAX_DURATION
from tests.ports import free_port

from .hostile_site import ATTACK, hostile_site
from .view_page import (
    PATIENCE,
    button_appears,
    centre_rows,
    choose,
    click,
    enter,
    inputs,
    looking_at,
    text_of,
    unfold,
    wait_for,
    without_pictures,
)

viser = pytest.importorskip("viser", reason="the view needs viser: install 'coheft[view]'")
sync_api = pytest.importorskip("playwright.sync_api", reason="browser tests need playwright")
_BROWSERS = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((path for path in map(shutil.which, _BROWSERS) if path is not None), None)

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX"),
    pytest.mark.skipif(BROWSER is None, reason=f"there is no browser: none of {', '.join(_BROWSERS)}"),
    pytest.mark.timeout(900),
]

REBOUND = "rebound.example"
"""A name of an attacker's that has come to lead to this machine."""
BUTTONS = (
    "Drop 3 kg",
    "Take a load away",
    "Pause",
    "Stop the run",
    "Restart with efficient",
    "Kill the chosen robot's agent",
    "Disturb",
    "Restore",
)
AGAIN = "Run it again"
SHEET = """(() => {
    const sheet = document.querySelector('.mantine-Paper-root[style*="max-height: 60%"]');
    const inner = sheet && sheet.querySelector(".mantine-ScrollArea-content > div").getBoundingClientRect();
    return inner && [inner.left, inner.width];
})()"""
"""Left edge and width of viser's panel on a phone [pixels]."""
LEGEND_BOTTOM = 'document.querySelector(".legend").getBoundingClientRect().bottom'
OUTSIDE = """[...document.querySelectorAll("button, input, table")].filter(each => {
    const {left, right, width} = each.getBoundingClientRect();
    return width > 0 && (left < 0 || right > innerWidth);
}).map(each => each.outerHTML)"""
"""What does not fit into the window."""


@contextmanager
def command(output: Path, *arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """``coheft`` with some arguments; ended by Ctrl-C if it has not ended by itself."""
    with output.open("wb") as file:
        process = subprocess.Popen(
            [sys.executable, "-m", "coheft", *arguments], stdout=file, stderr=subprocess.STDOUT, start_new_session=True
        )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE)


def run_file(folder: Path) -> RunFile:
    return msgspec.json.decode((folder / RUN_FILE).read_bytes(), type=RunFile)


def status(folder: Path) -> Status:
    return ask_server(run_file(folder), StatusRequest())


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=BROWSER,
            args=["--enable-unsafe-swiftshader", "--no-sandbox", f"--host-resolver-rules=MAP {REBOUND} 127.0.0.1"],
        )
        yield browser
        browser.close()


def port_of(url: str) -> int:
    return int(url.split("/")[2].rpartition(":")[2])


def url_in(output: Path) -> str:
    return next(word for word in output.read_text().split() if word.startswith("http"))


def goes_on(folder: Path) -> bool:
    """Whether the run in a folder answers: its file is there a little earlier."""
    try:
        find_run(folder)
    except CoheftError:
        return False
    return True


@contextmanager
def viewed_run(
    folder: Path, *arguments: str, options: Sequence[str] = (), before: Callable[[], None] = lambda: None
) -> Iterator[str]:
    """A run of three robots in real time, and the address of its view.

    Args:
        folder: Of the run.
        arguments: Of the run.
        options: Of the view.
        before: What happens before the view begins.
    """
    port = free_port()
    with command(folder.with_suffix(".out"), "run", "ring3", "--realtime", "--logs", str(folder), *arguments):
        wait_for(lambda: goes_on(folder), "the run to begin")
        before()
        output = folder.with_suffix(".view")
        with command(output, "view", str(folder), "--port", str(port), *options) as view:
            wait_for(lambda: "http" in output.read_text() or view.poll() is not None, "the view to begin")
            assert view.poll() is None, output.read_text()
            yield url_in(output)
        assert "Traceback" not in output.read_text()


def test_what_is_clicked_happens_and_the_last_picture_has_the_numbers_of_the_report(tmp_path, browser):
    folder, report = tmp_path / "run", tmp_path / "report.json"
    arguments = "--duration", "1000", "--change", "t=999,mass=1", "--json", str(report)  # no load before its time
    with viewed_run(folder, *arguments) as url, looking_at(browser, url) as page:
        wait_for(lambda: "true mass" in text_of(page), "the numbers")
        size = page.viewport_size
        page.set_viewport_size({"width": 1280, "height": 800})
        wait_for(lambda: 0 < page.evaluate(LEGEND_BOTTOM) <= 800, "the whole legend on the first screen")
        page.set_viewport_size(size)

        click(page, "Pause")  # and the machine has time for the browser
        wait_for(lambda: "paused: press Resume to continue" in text_of(page), "time to stand still")
        click(page, "Drop 3 kg")
        wait_for(lambda: [load.mass for load in status(folder).loads] == [3.0], "the load")
        click(page, "Drop 3 kg")
        wait_for(lambda: [load.id for load in status(folder).loads] == [1, 2], "another load")
        wait_for(lambda: "#1 of 3.0 kg · #2 of 3.0 kg" in text_of(page), "the loads to be shown, though paused")
        choose(page, "fan2017")
        button_appears(page, "Restart with fan2017")
        click(page, "Restart with fan2017")
        wait_for(lambda: status(folder).estimator == "fan2017", "the other estimator to be chosen")
        before = run_file(folder).pids["r1"]
        click(page, "Kill the chosen robot's agent")
        wait_for(lambda: run_file(folder).pids["r1"] != before, "the agent to come back")
        click(page, "Cut")
        wait_for(lambda: "cut the link r1-r2" in text_of(page), "the link to be cut")

        click(page, "Resume")
        choose(page, "#2")
        button_appears(page, "Take #2 away")
        click(page, "Take #2 away")
        wait_for(lambda: [load.id for load in status(folder).loads] == [1], "the chosen load to be gone")
        wait_for(lambda: "choose one" in inputs(page), "nothing to be chosen in its place")
        wait_for(lambda: "r2 is silent" in text_of(page), "the cut to be noticed")
        wait_for(lambda: "estimator fan2017" in text_of(page), "the other estimator to be used")
        click(page, "Mend")
        wait_for(lambda: "mended the link r1-r2" in text_of(page), "the link to be mended")
        unfold(page, "Disturb")
        button_appears(page, "Disturb")
        enter(page, "Loss, %", "100")
        enter(page, "Delay, ms", "250")
        wait_for(lambda: "250" in inputs(page), "the numbers to be entered")
        time.sleep(1.0)  # a browser sends what is entered a little later
        click(page, "Disturb")
        wait_for(lambda: "r1-r2: 100 % lost, others 0.25 s late" in text_of(page), "what is disturbed to be shown")
        wait_for(lambda: "r2 is silent" in text_of(page), "the loss to be noticed")
        click(page, "Restore")
        wait_for(lambda: "100 % lost" not in text_of(page).split("Scene")[0], "nothing to be disturbed any more")
        assert page.get_by_role("button", name="Drop 3 kg").count() == 1
        click(page, "Stop the run")
        wait_for(lambda: "the run has ended" in text_of(page), "the end")
        for button in ("Drop 3 kg", "Disturb", "Restore"):
            wait_for(page.get_by_role("button", name=button).first.is_disabled, "nothing to be done any more")
        assert page.get_by_role("button", name=AGAIN).count() == 0, "who only looks at a run cannot begin another one"
        wait_for(report.exists, "the report")
        told = json.loads(report.read_text())
        assert told["estimator"] == "fan2017"
        robot = told["robots"]["r1"]
        assert [change["truth"]["mass"] for change in told["load_changes"]][-1] == pytest.approx(robot["mass"]["truth"])
        numbers = [f"{told['duration_s']:.1f} of 1000 s"]
        numbers += centre_rows(robot)
        wait_for(lambda: all(number in text_of(page) for number in numbers), f"{numbers}")


def test_a_recording_plays_to_its_end_with_the_numbers_of_the_report(tmp_path, browser):
    recording, report = tmp_path / "run.mcap", tmp_path / "report.json"
    arguments = "ring3", "--duration", "6", "--logs", str(tmp_path / "run")
    with command(tmp_path / "out", "run", *arguments, "--record", str(recording), "--json", str(report)) as run:
        assert run.wait(PATIENCE) in (0, 3), (tmp_path / "out").read_text()
    told = json.loads(report.read_text())
    output = tmp_path / "view"
    with command(output, "view", str(recording), "--port", str(free_port())):
        wait_for(lambda: "http" in output.read_text(), "the view to begin")
        with looking_at(browser, url_in(output)) as page:
            wait_for(lambda: "a recording: run.mcap" in text_of(page), "the recording")
            wait_for(lambda: "6.0 of 6 s" in text_of(page), "the end")
            wait_for(lambda: "finished" in text_of(page), "the player to stop")
            robot = told["robots"]["r1"]
            assert robot["com"]["estimate"] is not None
            assert page.evaluate(SHEET) is None, "beside the scene there are panels"
            page.set_viewport_size({"width": 390, "height": 844})
            wait_for(lambda: page.evaluate(SHEET) == [0, 390], "a panel as wide as a phone")
            assert page.evaluate(OUTSIDE) == []
            numbers = centre_rows(robot)
            wait_for(lambda: all(number in text_of(page) for number in numbers), f"{numbers}")


def test_a_view_that_is_started_with_a_run_stays_until_it_is_interrupted(tmp_path, browser):
    folder, output = tmp_path / "run", tmp_path / "out"
    with command(output, "run", "ring3", "--duration", "1000", "--view", "--logs", str(folder)) as run:
        wait_for(lambda: "http" in output.read_text() or run.poll() is not None, "the view to begin")
        url = url_in(output)
        assert output.read_text().startswith("The view is at http"), "the address comes first"
        assert not goes_on(folder), "the run waits for somebody to look"
        with looking_at(browser, url) as page:
            wait_for(lambda: goes_on(folder), "the run to begin")
            wait_for(lambda: "true mass" in text_of(page), "the numbers")
            ask_server(run_file(folder), StopRequest())
            wait_for(lambda: "until Ctrl-C" in output.read_text(), "the run to end")
            wait_for(lambda: "the run has ended" in text_of(page), "the last picture")
        assert run.poll() is None
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE) in (0, 3), output.read_text()
    log = (folder / "view.log").read_text()
    assert "Traceback" not in log
    assert url.split("/")[3] not in log, "others may read it"
    with pytest.raises(OSError, match=r"refused|timed out"):
        socket.create_connection(("127.0.0.1", port_of(url)), timeout=1.0)


def test_a_run_that_has_ended_can_be_run_again_at_the_same_address(tmp_path, browser, own_state_folder):
    output = tmp_path / "out"
    with command(output, "run", "ring3", "--duration", "2", "--view", "--no-wait") as run:
        wait_for(lambda: "The view stays until Ctrl-C" in output.read_text(), "the first run to end")
        url = url_in(output)
        with looking_at(browser, url) as page:
            wait_for(page.get_by_role("button", name=AGAIN).count, "the offer of another run")
            click(page, AGAIN)
            wait_for(lambda: output.read_text().count("The view stays until Ctrl-C") == 2, "the second run to end")
            wait_for(lambda: "2.0 of 2 s" in text_of(page), "the page to show it")
        assert run.poll() is None
    assert {word for word in output.read_text().split() if word.startswith("http")} == {url}


def test_a_run_with_a_view_goes_on_until_it_is_stopped(tmp_path):
    folder, output = tmp_path / "run", tmp_path / "out"
    with command(output, "run", "ring3", "--view", "--no-wait", "--logs", str(folder)):
        wait_for(lambda: goes_on(folder), "the run to begin")
        assert status(folder).duration == MAX_DURATION
        wait_for(lambda: status(folder).block >= 25, "every robot to have said something")
        ask_server(run_file(folder), StopRequest())
        wait_for(lambda: "until Ctrl-C" in output.read_text(), "the run to end")
    assert "too late" not in output.read_text(), "no robot is late where time waits for it"


def test_ctrl_c_during_a_run_ends_its_view_too_and_the_results_are_there(tmp_path):
    folder, output, report = tmp_path / "run", tmp_path / "out", tmp_path / "report.json"
    with command(output, "run", "ring3", "--view", "--no-wait", "--json", str(report), "--logs", str(folder)) as run:
        wait_for(lambda: goes_on(folder) and status(folder).block >= 25, "every robot to have said something")
        run.send_signal(signal.SIGINT)
        assert run.wait(PATIENCE) == 130, output.read_text()
    assert report.is_file()
    assert "What each robot found out" in output.read_text()
    assert "The view stays" not in output.read_text()


def test_a_hostile_page_gets_nothing(tmp_path, browser):
    folder, arguments = tmp_path / "run", ("--duration", "1000", "--change", "t=999,mass=1", "--secure")
    with viewed_run(folder, *arguments) as url, hostile_site() as site:
        token, port = url.split("/")[3], port_of(url)
        protocol = f"viser-v{viser.__version__}"
        context = without_pictures(browser)
        friendly = context.new_page()  # which the user looks at meanwhile, in the same browser
        friendly.goto(url)
        wait_for(lambda: "true mass" in text_of(friendly), "the numbers")
        before = status(folder)
        hostile = context.new_page()
        for address in (f"http://127.0.0.1:{site}/", f"http://{REBOUND}:{site}/", f"http://{REBOUND}:{port}/"):
            hostile.goto(address)  # and somehow it knows the secret
            assert hostile.evaluate(ATTACK, [port, token, protocol]) == [], address
        now = status(folder)
        assert now.state == "running"
        assert now.time > before.time
        assert not now.loads
        assert "Drop 3 kg" in text_of(friendly), "who has the address is not disturbed"
        assert f"open ws://127.0.0.1:{port}/{token}" in friendly.evaluate(ATTACK, [port, token, protocol])
        context.close()


@contextmanager
def run_with_a_view_to_look_at(folder: Path, *_: str) -> Iterator[str]:
    """The same with one command."""
    output = folder.with_suffix(".out")
    with command(output, "run", "ring3", "--duration", "1000", "--view-read-only", "--logs", str(folder)) as run:
        wait_for(lambda: "http" in output.read_text() or run.poll() is not None, "the view to begin")
        yield url_in(output)


@pytest.mark.parametrize("begin", [partial(viewed_run, options=["--read-only"]), run_with_a_view_to_look_at])
def test_who_may_only_look_sees_all_and_has_no_buttons(tmp_path, browser, begin):
    with begin(tmp_path / "run", "--duration", "1000") as url, looking_at(browser, url) as page:
        wait_for(lambda: "true mass" in text_of(page), "the numbers")
        wait_for(lambda: words.READ_ONLY in text_of(page), "the reason")
        assert not set(BUTTONS) & set(page.get_by_role("button").all_inner_texts())


def test_without_the_keys_of_an_operator_the_view_is_an_observer(tmp_path, browser):
    folder = tmp_path / "run"
    leave = lambda: (folder / "keys" / "operator.key").unlink()  # noqa: E731
    with viewed_run(folder, "--duration", "1000", "--secure", before=leave) as url, looking_at(browser, url) as page:
        wait_for(lambda: "true mass" in text_of(page), "the numbers")
        wait_for(lambda: words.NO_OPERATOR in text_of(page), "the reason")
        assert not set(BUTTONS) & set(page.get_by_role("button").all_inner_texts())
