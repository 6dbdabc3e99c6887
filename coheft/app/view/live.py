"""The view of a run in progress."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

import viser

from coheft.app.run.folder import locate_run
from coheft.app.run.observer import Observer, may_operate, observe
from coheft.app.view import words
from coheft.app.view.controls import Controls
from coheft.app.view.model import ViewModel
from coheft.app.view.page import FRAME, Page
from coheft.app.view.place import Place
from coheft.app.view.server import open_server
from coheft.wire.messages.requests import RunState, Status, StatusRequest

_STATUS_EVERY = 0.5
_STILL = 1.0
"""Time without progress after which the view shows for which robots the run waits [s]."""
_LAST_NEWS = 1.0
"""Time after the end of the run in which last estimates may arrive [s]."""


def view_run(folder: Path | None, place: Place, shown: Callable[[], None], *, read_only: bool) -> None:
    """Show a run, or without a folder the newest one in progress, at a place; otherwise as ``show_run``."""
    folder, _ = locate_run(folder)
    with open_server(place) as server:
        show_run(server, folder, shown, read_only=read_only)


def show_run(
    server: viser.ViserServer,
    folder: Path,
    shown: Callable[[], None] = lambda: None,
    *,
    read_only: bool,
    ask_again: Callable[[], None] | None = None,
) -> NoReturn:
    """Show the run in a folder until Ctrl-C; after its end, the last state stays visible.

    ``shown`` is called when the page is complete. A view that is ``read_only`` has no controls, as without the
    operator's keys. ``ask_again`` requests another run when this one has ended; None if there cannot be one.
    """
    folder, run_file = locate_run(folder)
    with observe(run_file) as observer:
        status = observer.ask(StatusRequest())
        model = ViewModel(status)
        page = Page(server, model)
        controls: Controls | None = None
        if read_only or not may_operate(run_file):
            with page.controls:
                server.gui.add_html(words.small(words.READ_ONLY if read_only else words.NO_OPERATOR))
        else:
            controls = Controls(page, model, run_file, folder)
        shown()
        _follow(observer, model, page, controls)
    if controls is not None:
        controls.end(ask_again)
    while True:
        page.draw(model, words.ENDED)
        time.sleep(FRAME)


def _follow(observer: Observer, model: ViewModel, page: Page, controls: Controls | None) -> None:
    """Show news until the run has ended or its server is lost."""
    asked_at = drawn_at = -math.inf
    moved_at, end_at, seen = time.monotonic(), math.inf, model.record.time
    while not observer.has_lost_server and time.monotonic() < end_at:
        for news in observer.collect(model.scene, FRAME):
            model.receive(news)
        if (now := time.monotonic()) > asked_at + _STATUS_EVERY:
            asked_at = now
            status: Status | None = observer.status()
            if status is not None:
                model.note_status(status)
                if controls is not None:
                    controls.update()
                if status.state is RunState.FINISHED:
                    end_at = min(end_at, now + _LAST_NEWS)
        if model.record.time != seen:
            moved_at, seen = now, model.record.time
        if (now := time.monotonic()) > drawn_at + FRAME:
            drawn_at = now
            page.draw(model, words.waiting_note(model.status, is_still=now > moved_at + _STILL))
