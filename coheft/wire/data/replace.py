"""Atomic replacement of files: an incomplete file never appears, whatever happens."""

import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import BinaryIO

_parts: set[Path] = set()
"""Files that are being written and not yet complete."""


def replace_files(writers: Mapping[Path, Callable[[BinaryIO], None]], old: Iterable[Path] = ()) -> None:
    """Write files, each beside its place first. If one cannot be written, all existing files stay unchanged.

    ``writers`` has functions that write the files, by path; ``old`` files are removed when all new ones are written.

    Raises:
        OSError: A file cannot be written, or an old one cannot be removed.
    """
    parts = {path.with_name(f"{path.name}.part"): path for path in writers}
    try:
        _parts.update(parts)
        for part, path in parts.items():
            with part.open("wb") as file:
                writers[path](file)
                file.flush()
                os.fsync(file.fileno())  # otherwise a power failure may leave a file without its content
        _parts.difference_update(parts)  # complete from now on
        for path in old:  # removed before the first new file appears: an interruption leaves no mixture
            path.unlink()
        for part, path in parts.items():
            part.replace(path)
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
        _parts.difference_update(parts)


def remove_parts() -> None:
    """Remove incomplete files, because the process is about to exit at once."""
    for part in _parts.copy():
        part.unlink(missing_ok=True)
