"""The view in a process of its own beside a run: however slow a browser is, the run does not wait for it.

``python -m coheft.app.view.process`` reads a ``ViewConfig`` from stdin.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

import msgspec

from coheft.app.run.folder import find_run
from coheft.app.run.heard import News
from coheft.app.run.processes import Processes
from coheft.app.view.ports import choose_port, new_token, url
from coheft.errors import CoheftError
from coheft.wire.messages.requests import Status
from coheft.wire.process.supervised import supervised_main

_LOOK_EVERY = 0.2
_READY = "the view is ready"
"""A line of its log, which others may read: the secret is not in it."""


class ViewConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the view's process is told.

    Attributes:
        folder: Of the run.
        host: Where browsers may dial in.
        port: Where.
        token: The secret in its address.
        read_only: Whether it shows but does not act.
    """

    folder: str
    host: str
    port: int
    token: str
    read_only: bool = False


class ViewBeside:
    """A follower with the view of a run beside it. The view gets ready while the run does; leaving the context ends it.

    Args:
        folder: Of the run.
        host: Where browsers may dial in.
        port: Where; None: any that is free.
        tell: Is told where the view is.
        read_only: Whether it shows but does not act.

    Raises:
        LinkError: The port is taken.
    """

    def __init__(
        self, folder: Path, host: str, port: int | None, tell: Callable[[str], None], *, read_only: bool = False
    ) -> None:
        self._config = ViewConfig(str(folder), host, choose_port(host, port), new_token(), read_only)
        self._tell = tell
        self._processes = Processes(folder)
        self._is_told = False
        self._look_at = 0.0

    @property
    def url(self) -> str:
        """Where the view is."""
        return url(self._config.host, self._config.port, self._config.token)

    def begin(self, status: Status) -> None:
        """The view asks for itself."""

    def hear(self, news: News) -> None:
        """The view hears for itself; tell where it is as soon as it can be looked at."""
        if (now := time.monotonic()) >= self._look_at:
            self._look_at = now + _LOOK_EVERY
            self._look()

    def _look(self) -> None:
        if not self._is_told and any(_READY in line for child in self._processes.children for line in child.lines):
            self._is_told = True
            self._tell(self.url)

    def end(self, status: Status) -> None:
        """The last picture stays until the context ends."""
        self._look()

    @property
    def is_there(self) -> bool:
        """Whether it can be looked at."""
        return self._is_told and not self._processes.ended("view")

    @property
    def log(self) -> Path:
        """What it has said."""
        return Path(self._config.folder) / "view.log"

    def wait(self) -> None:
        """Let people look until Ctrl-C."""
        try:
            while self.is_there:
                time.sleep(_LOOK_EVERY)
        except KeyboardInterrupt:
            return

    def __enter__(self) -> Self:
        self._processes.start("view", "coheft.app.view.process", self._config)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._processes.stop()


def _view(config: ViewConfig) -> None:
    # viser takes a second, and whoever starts this process needs none of it
    from coheft.app.view.door import Door
    from coheft.app.view.live import view_run

    folder = Path(config.folder)
    while not _goes_on(folder):
        time.sleep(_LOOK_EVERY)
    door = Door(config.host, config.token)
    view_run(folder, door, config.port, lambda _: print(_READY, flush=True), read_only=config.read_only)


def _goes_on(folder: Path) -> bool:
    try:
        find_run(folder)
    except CoheftError:
        return False
    return True


def main() -> NoReturn:
    """Show the run whose folder comes on stdin."""
    supervised_main(ViewConfig, _view)


if __name__ == "__main__":
    main()
