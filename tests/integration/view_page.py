"""The page of a view in a browser: what it shows, and its buttons and lists."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

from coheft.app.terminal.digits import decimals_for
from tests.waiting import wait_until

PATIENCE = 180.0
"""Software draws the page, and slowly [s]."""

wait_for = partial(wait_until, limit=PATIENCE)


NO_PICTURES = """
    for (const draw of ["drawArrays", "drawElements", "drawArraysInstanced", "drawElementsInstanced"])
        WebGL2RenderingContext.prototype[draw] = () => {};
    window.requestAnimationFrame = draw => setTimeout(() => draw(performance.now()), 1000);
"""
"""The scene, which these tests do not look at, takes software most of a second for each picture."""


def without_pictures(browser: Any) -> Any:
    """A context of pages that do not draw the scene, and have room for all panels."""
    context = browser.new_context(viewport={"width": 900, "height": 1100}, device_scale_factor=0.3)
    context.add_init_script(NO_PICTURES)
    return context


@contextmanager
def looking_at(browser: Any, url: str) -> Iterator[Any]:
    context = without_pictures(browser)
    page = context.new_page()
    page.set_default_timeout(1e3 * PATIENCE)
    failures: list[str] = []
    page.on("pageerror", lambda error: failures.append(str(error)))
    try:
        page.goto(url)
        yield page
        assert not failures
    finally:  # or the browser draws it for all tests that follow
        context.close()


def text_of(page: Any) -> str:
    return str(page.evaluate("document.body.innerText"))


def centre_rows(robot: Any) -> list[str]:
    """What the page shows of a centre of mass: the truth, the estimate, its deviation; dashes for what is not known."""
    com, rows = robot["com"], []
    for row, axis in enumerate("xyz"):
        decimals = 1 if com["std"] is None else decimals_for(1e3 * com["std"][row], 2, at_least=1)
        columns = [com["truth"], com["estimate"], com["std"]]
        numbers = ["–" if values is None else f"{1e3 * values[row]:.{decimals}f}" for values in columns]
        rows.append("\t".join([f"{axis} mm", *numbers]))
    return rows


def inputs(page: Any) -> list[str]:
    """What all fields and lists say."""
    values: list[str] = page.locator("input").evaluate_all("fields => fields.map(field => field.value)")
    return values


def click(page: Any, button: str) -> None:
    """By script: where software draws the scene, a mouse has to wait for the next picture, and that can take long."""
    page.get_by_role("button", name=button, exact=True).first.evaluate("button => button.click()")


def unfold(page: Any, folder: str) -> None:
    """Show what is in a folder of the panel."""
    page.get_by_text(folder, exact=True).first.evaluate("label => label.click()")


def choose(page: Any, option: str) -> None:
    """From a list, by script, too: without opening it."""
    page.locator(f"[role=option][value='{option}']").first.evaluate("option => option.click()")


def enter(page: Any, label: str, value: str) -> None:
    """A number beside a slider."""
    row = page.locator("label", has_text=label).first.locator("xpath=ancestor::*[.//input][1]")
    row.locator("input").last.evaluate(
        """(field, value) => {
            Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, value);
            field.dispatchEvent(new Event("input", {bubbles: true}));
        }""",
        value,
    )


def button_appears(page: Any, label: str) -> None:
    """The view has heard what was chosen. A browser sends only the last of several messages within 50 ms."""
    wait_for(lambda: page.get_by_role("button", name=label, exact=True).count(), f"the button '{label}'")
