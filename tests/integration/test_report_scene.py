"""The scene in the page of a report, in a browser: it is drawn, it moves, and nothing is wider than a telephone."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from coheft.app.cli.main import run_command_line
from tests.recording.runs import news_of_a_run, record

sync_api = pytest.importorskip("playwright.sync_api", reason="takes the package playwright")
pytest.importorskip("matplotlib")
pytest.importorskip("jinja2")

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="takes Chromium")
INK = """canvas => {
  const pixels = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data;
  let drawn = 0;
  for (let k = 3; k < pixels.length; k += 4) drawn += pixels[k] > 0;
  return drawn / (pixels.length / 4);
}"""
"""Which share of the picture is not empty."""


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("scene")
    recording = record(folder / "run.mcap", news_of_a_run())
    assert run_command_line(["report", str(recording), str(folder / "report")]) == 0
    return folder / "report" / "report.html"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield browser
        browser.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_the_scene_is_drawn_and_follows_the_time(browser: Any, page_file: Path, width: int) -> None:
    page = browser.new_page(viewport={"width": width, "height": 800})
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.on("request", lambda request: errors.append(request.url) if request.url.startswith("http") else None)
    page.goto(page_file.as_uri())
    canvas = page.locator("#scene-canvas")
    assert canvas.evaluate(INK) > 0.001
    before = canvas.evaluate("canvas => canvas.toDataURL()")
    end = page.locator("#scene-time").get_attribute("max")
    page.locator("#scene-time").fill(end)
    assert canvas.get_attribute("data-time") == f"{float(end):.2f}"
    page.mouse.move(*[canvas.bounding_box()[side] + 100 for side in ("x", "y")])
    page.mouse.down()
    page.mouse.move(*[canvas.bounding_box()[side] + 160 for side in ("x", "y")])
    page.mouse.up()
    assert canvas.evaluate("canvas => canvas.toDataURL()") != before
    page.locator("#scene-play").click()
    page.wait_for_function("document.getElementById('scene-play').textContent === 'Play'")  # it ends by itself
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert errors == []
    page.close()
