"""Files that are replaced as a whole: whatever happens meanwhile, none of them is ever there in part."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

_parts: set[Path] = set()
"""What is being written now, and not yet complete."""


def replace_files(writers: Mapping[Path, Callable[[BinaryIO], None]], old: Iterable[Path] = ()) -> None:
    """Write files, each beside its place first. If one cannot be written, all that was there stays as it was.

    Args:
        writers: What writes each file, by its path.
        old: Files that go as soon as all new ones are written.

    Raises:
        OSError: A file cannot be written, or an old one not be removed.
    """
    parts = {path.with_name(f"{path.name}.part"): path for path in writers}
    try:
        _parts.update(parts)
        for part, path in parts.items():
            with part.open("wb") as file:
                writers[path](file)
                file.flush()
                os.fsync(file.fileno())  # else a power cut may leave the new name without what belongs to it
        _parts.difference_update(parts)  # from now on they are all there is
        for path in old:  # before the first new one comes: who is killed in between leaves no mixture
            path.unlink()
        for part, path in parts.items():
            part.replace(path)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
        _parts.difference_update(parts)


def remove_parts() -> None:
    """Remove what is not complete, because the process is about to leave at once."""
    for part in _parts.copy():
        part.unlink(missing_ok=True)
