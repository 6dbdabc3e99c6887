"""Removal of new, empty folders when a command is aborted."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def gone_if_broken_off(folder: Path | None) -> Iterator[None]:
    """Remove a folder that was made within the context and is empty, if an error or Ctrl-C ends the context.

    Parent folders that were made within the context are removed, too. None: there is no folder.
    """
    new = [] if folder is None else [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        yield
    except BaseException:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        raise
