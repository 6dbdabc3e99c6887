"""A report takes the place of the one that was in its folder before: nothing of that one stays beside the new page."""

from __future__ import annotations

from pathlib import Path

from coheft.app.run_report.data import SUFFIXES, TABLES
from coheft.app.run_report.pictures import PICTURES


def remove_former(page: Path) -> None:
    """Remove the pictures and tables that a page shows and names, if it is there; whatever else is beside it stays.

    Args:
        page: Of the former report.

    Raises:
        OSError: Something cannot be read or removed.
    """
    if not page.is_file():
        return
    text = page.read_text(encoding="utf-8", errors="replace")
    pictures = [f"{name}.png" for name in PICTURES if f'id="figure-{name}"' in text]
    tables = [f"{name}{suffix}" for name in TABLES for suffix in SUFFIXES if f"<dt>{name}{suffix}</dt>" in text]
    for name in (*pictures, *tables):
        (page.parent / name).unlink(missing_ok=True)
