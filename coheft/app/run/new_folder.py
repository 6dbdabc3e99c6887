"""Folders that are made before there is anything to put into them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def gone_if_broken_off(folder: Path | None) -> Iterator[None]:
    """Take a folder away again that was made within the context and is empty, if an error or Ctrl-C ends that.

    Those above it that were made for it go with it. None: there is no folder.
    """
    new = [] if folder is None else [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        yield
    except BaseException:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        raise
