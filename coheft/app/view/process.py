"""The view of a run in a separate process, so that the run does not wait for slow browsers.

``python -m coheft.app.view.process`` reads a ``ViewConfig`` from stdin.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import NoReturn, Self

import msgspec

from coheft.app.run.folder import find_run
from coheft.app.run.processes import ProcessError, Processes
from coheft.app.view.place import Place
from coheft.errors import CoheftError
from coheft.wire.process.supervised import supervised_main

_LOOK_EVERY = 0.2
READY, SEEN, _AGAIN = "the view is ready", "a browser is connected", "again"
"""Lines of its log, which does not contain the secret, because others may read it."""


class ViewConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Configuration of the view's process.

    Attributes:
        folder: Folder of the run, which may not have begun yet.
        read_only: Whether the view has no controls.
        offers_another: Whether it offers another run when this one has ended.
    """

    folder: str
    place: Place
    read_only: bool = False
    offers_another: bool = False


class ViewBeside:
    """The process of a view, with its own links to the run; it starts before the run, and ends with the context."""

    def __init__(self, config: ViewConfig) -> None:
        self._config = config
        self._processes = Processes(Path(config.folder))

    @property
    def is_there(self) -> bool:
        """Whether the view is ready."""
        return READY in self._child.lines and not self._processes.ended("view")

    @property
    def log(self) -> Path:
        """Path of its log."""
        return self._child.log

    def wait_for(self, line: str) -> None:
        """Wait until the view has said ``READY``, or ``SEEN``; raise a ``ProcessError`` if it fails."""
        while line not in self._child.lines:
            self._processes.check()
            time.sleep(_LOOK_EVERY)

    def wait_for_another(self) -> bool:
        """Show the view until Ctrl-C or a request for another run; return whether there was such a request."""
        try:
            self.wait_for(_AGAIN)
        except (KeyboardInterrupt, ProcessError):
            return False
        return True

    def __enter__(self) -> Self:
        self._child = self._processes.start("view", "coheft.app.view.process", self._config)
        return self

    def __exit__(self, *_: object) -> None:
        self._processes.stop()


def _view(config: ViewConfig) -> None:
    # the import of viser takes a second, and the parent does not need it
    from coheft.app.view.live import show_run
    from coheft.app.view.server import open_server

    folder, is_seen = Path(config.folder), False
    ask_again = partial(_say, _AGAIN) if config.offers_another else None
    with open_server(config.place) as server:
        _say(READY)
        waiting = server.gui.add_markdown("Waiting for the robots …")
        while not _goes_on(folder):
            if not is_seen and server.get_clients():
                is_seen = True
                _say(SEEN)
            time.sleep(_LOOK_EVERY)
        waiting.remove()
        show_run(server, folder, read_only=config.read_only, ask_again=ask_again)


def _say(line: str) -> None:
    print(line, flush=True)


def _goes_on(folder: Path) -> bool:
    try:
        find_run(folder)
    except CoheftError:
        return False
    return True


def main() -> NoReturn:
    """Show the run that the configuration on stdin names."""
    supervised_main(ViewConfig, _view)


if __name__ == "__main__":
    main()
