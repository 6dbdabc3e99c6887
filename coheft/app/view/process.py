"""The view in a process of its own beside a run: however slow a browser is, the run does not wait for it.

``python -m coheft.app.view.process`` reads a ``ViewConfig`` from stdin.
"""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import NoReturn, Self

import msgspec

from coheft.app.run.folder import find_run
from coheft.app.run.follower import Follower
from coheft.app.run.processes import Processes
from coheft.app.view.ports import choose_port, new_token, url
from coheft.errors import CoheftError
from coheft.wire.process.supervised import supervised_main

_LOOK_EVERY = 0.2
_READY, _SEEN, _AGAIN = "the view is ready", "somebody looks", "again"
"""Lines of its log, which others may read: the secret is not in them."""


class Place(msgspec.Struct, frozen=True):
    """Where a view is: the next run may have its view at the same place.

    Attributes:
        host: Where browsers may dial in.
        port: Where.
        token: The secret in its address.
    """

    host: str
    port: int
    token: str

    @classmethod
    def choose(cls, host: str, port: int | None = None) -> Place:
        """A place with a new secret; without a port, at any that is free.

        Raises:
            LinkError: The port is taken.
        """
        return cls(host, choose_port(host, port), new_token())

    @property
    def url(self) -> str:
        """Its address."""
        return url(self.host, self.port, self.token)


class ViewConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the view's process is told.

    Attributes:
        folder: Of the run, which may still be about to begin.
        place: Where it is.
        read_only: Whether it shows but does not act.
        offers_another: Whether it offers another run when this one has ended.
    """

    folder: str
    place: Place
    read_only: bool = False
    offers_another: bool = False


class ViewBeside(Follower):
    """The view of a run beside it, which asks and hears for itself: there before the run, until the context ends.

    Args:
        folder: Of the run.
        place: Where it is.
        read_only: Whether it shows but does not act.
        offers_another: Whether it offers another run when this one has ended.
    """

    def __init__(self, folder: Path, place: Place, *, read_only: bool = False, offers_another: bool = False) -> None:
        self._config = ViewConfig(str(folder), place, read_only, offers_another)
        self._processes = Processes(folder)

    @property
    def is_there(self) -> bool:
        """Whether it can be looked at."""
        return self._has_said(_READY) and not self._processes.ended("view")

    @property
    def log(self) -> Path:
        """What it has said."""
        return Path(self._config.folder) / "view.log"

    def wait_until_there(self) -> bool:
        """Wait until it can be looked at, and say whether it can."""
        return self._wait_for(_READY)

    def wait_until_seen(self) -> bool:
        """Wait until somebody looks, and say whether somebody does."""
        return self._wait_for(_SEEN)

    def wait_for_another(self) -> bool:
        """Let people look until Ctrl-C, or until they ask for another run; say whether they do."""
        try:
            return self._wait_for(_AGAIN)
        except KeyboardInterrupt:
            return False

    def _wait_for(self, line: str) -> bool:
        while not self._has_said(line):
            if self._processes.ended("view"):
                return False
            time.sleep(_LOOK_EVERY)
        return True

    def _has_said(self, line: str) -> bool:
        return any(line in child.lines for child in self._processes.children)

    def __enter__(self) -> Self:
        self._processes.start("view", "coheft.app.view.process", self._config)
        return self

    def __exit__(self, *_: object) -> None:
        self._processes.stop()


def _view(config: ViewConfig) -> None:
    # viser takes a second, and whoever starts this process needs none of it
    from coheft.app.view.door import Door
    from coheft.app.view.live import show_run
    from coheft.app.view.server import open_server

    folder, place, is_seen = Path(config.folder), config.place, False
    ask_again = partial(_say, _AGAIN) if config.offers_another else None
    with open_server(Door(place.host, place.token), place.port) as server:
        _say(_READY)
        waiting = server.gui.add_markdown("Waiting for the robots …")
        while not _goes_on(folder):
            if not is_seen and server.get_clients():
                is_seen = True
                _say(_SEEN)
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
    """Show the run whose folder comes on stdin."""
    supervised_main(ViewConfig, _view)


if __name__ == "__main__":
    main()
