"""Draw the pictures of the view: real runs, paused, in a headless browser.

``python docs/draw_view.py`` needs playwright and Chromium, and takes some minutes where software draws the scene.
"""

import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from playwright.sync_api import Page, sync_playwright

from coheft.app.run.folder import RunFile, find_run
from coheft.app.run.observer import ask_server
from coheft.errors import CoheftError
from coheft.wire.messages.requests import PauseRequest, StatusRequest

PICTURES = Path(__file__).parent / "pictures"
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
LIMIT = 180.0
T = TypeVar("T")


@dataclass(frozen=True)
class Shot:
    """One picture.

    Attributes:
        name: Name of the file.
        scenario: Name of the scenario.
        at: Simulated time [s].
        size: Size of the window [pixels].
    """

    name: str
    scenario: str
    at: float
    size: tuple[int, int] = (1440, 900)


SHOTS = (
    Shot("view", "real6", 24.0),
    Shot("view-phone", "real6", 24.0, (390, 844)),
    Shot("view-crate", "crate4", 12.0, (1280, 900)),
)


@contextmanager
def paused_run(scenario: str, at: float) -> Iterator[str]:
    """Pause a run at a simulated time [s]; yield the URL of its view."""
    with tempfile.TemporaryDirectory() as folder:
        logs, output = Path(folder) / "run", Path(folder) / "out"
        arguments = ["run", scenario, "--view", "--no-wait", "--logs", str(logs)]
        with output.open("wb") as file:
            run = subprocess.Popen([sys.executable, "-m", "coheft", *arguments], stdout=file)
        try:
            run_file = until(lambda: run_in(logs), "the run to begin")
            assert run_file is not None
            until(lambda: ask_server(run_file, StatusRequest()).time >= at, f"{at:g} s")
            ask_server(run_file, PauseRequest(paused=True))
            yield next(word for word in output.read_text().split() if word.startswith("http"))
        finally:
            run.send_signal(signal.SIGINT)
            run.wait(LIMIT)


def run_in(folder: Path) -> RunFile | None:
    """Return the addresses of the run in a folder; None if there is none yet."""
    try:
        return find_run(folder)
    except CoheftError:
        return None


def until(condition: Callable[[], T], what: str) -> T:
    """Wait until a condition returns something true, and return that."""
    end = time.monotonic() + LIMIT
    while not (found := condition()):
        if time.monotonic() > end:
            raise TimeoutError(f"waited {LIMIT:g} s for {what}")
        time.sleep(0.05)
    return found


def text_of(page: Page) -> str:
    """Return the text of a page."""
    return str(page.evaluate("document.body.innerText"))


def take(browser: Any, url: str, shot: Shot) -> None:
    """Take one picture, without the browser's notice of software rendering."""
    width, height = shot.size
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(1e3 * LIMIT)
    page.goto(url)
    until(lambda: "paused" in text_of(page) and "own std" not in text_of(page), "the numbers")
    for _ in range(3):
        page.evaluate("document.querySelectorAll('.mantine-Notification-closeButton').forEach(each => each.click())")
        time.sleep(4.0)  # the scene is loaded in parts
    page.screenshot(path=PICTURES / f"{shot.name}.png")
    page.close()


def main() -> None:
    """Take all pictures, or the named ones."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # otherwise ignored by runs in the background
    wanted = [shot for shot in SHOTS if shot.name in sys.argv[1:] or not sys.argv[1:]]
    path = next(filter(None, map(shutil.which, BROWSERS)))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--enable-unsafe-swiftshader", "--no-sandbox"])
        for scenario, at in sorted({(shot.scenario, shot.at) for shot in wanted}):
            with paused_run(scenario, at) as url:
                for shot in wanted:
                    if (shot.scenario, shot.at) == (scenario, at):
                        take(browser, url, shot)
        browser.close()


if __name__ == "__main__":
    main()
