"""The folder of a report: the page, its pictures, the data, and the report for programs."""

from __future__ import annotations

import os
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

from coheft.app.figures import DARK, LIGHT, Theme, figure_to
from coheft.app.results.report import Report, write_report
from coheft.app.run_report.data import SUFFIXES, TABLES, write_data
from coheft.app.run_report.page import Drawn, render_page
from coheft.app.run_report.pictures import PICTURES, Picture, pictures_of
from coheft.app.run_report.series import Series, SeriesFollower
from coheft.errors import CoheftError, MissingPackageError
from coheft.wire.scenario.schema import Scenario

PAGE = "report.html"
_WIDTH = 10.0
"""Width of pictures [inches]."""


class ReportPage(SeriesFollower):
    """Follows a run, and then writes its report.

    Raises:
        CoheftError: The folder cannot be made.
        MissingPackageError: A package that draws or writes the page is not installed.
    """

    def __init__(self, folder: Path) -> None:
        prepare_folder(folder)
        self._folder = folder

    def write(self, scenario: Scenario, clock: str, report: Report) -> Path:
        """Write the report; return the path of the page.

        Raises:
            CoheftError: It cannot be written.
        """
        return write_folder(self._folder, scenario, clock, self.series, report)


def prepare_folder(folder: Path) -> None:
    """Make the folder, so that a run does not end without one.

    Raises:
        CoheftError: It cannot be made.
        MissingPackageError: A package that draws or writes the page is not installed.
    """
    for package, module in (("matplotlib", "matplotlib"), ("Jinja2", "jinja2")):
        if find_spec(module) is None:
            raise MissingPackageError(package, "report")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CoheftError(
            f"cannot make the folder of the report, {folder}: {error.strerror}; name another: --report DIR"
        ) from error
    if not os.access(folder, os.W_OK):
        raise CoheftError(f"nothing can be written into {folder}; name another folder: --report DIR")


def write_folder(folder: Path, scenario: Scenario, clock: str | None, series: Series, report: Report) -> Path:
    """Write a report, in place of a former one in the folder; return the path of the page.

    ``clock`` is None for a recording.

    Raises:
        CoheftError: It cannot be written.
    """
    page = folder / PAGE
    try:
        _remove_former(page)
        write_report(report, str(folder / "report.json"))
        data = write_data(series, folder)
        drawn = []
        for picture in pictures_of(series, report):
            light, dark = (_draw(picture, theme, series, report) for theme in (LIGHT, DARK))
            (folder / f"{picture.name}.png").write_bytes(light)
            drawn.append(Drawn(picture, light, dark))
        page.write_text(render_page(scenario, clock, series, report, drawn, data), encoding="utf-8")
    except OSError as error:
        raise CoheftError(f"cannot write the report into {folder}: {error.strerror}") from error
    return page


def _draw(picture: Picture, theme: Theme, series: Series, report: Report) -> bytes:
    image = BytesIO()
    with figure_to(image, _WIDTH, picture.height, theme) as figure:
        picture.draw(figure, theme, series, report)
    return image.getvalue()


def _remove_former(page: Path) -> None:
    """Remove the pictures and tables that a former page shows and names, if it is there; all else beside it stays."""
    if not page.is_file():
        return
    text = page.read_text(encoding="utf-8", errors="replace")
    pictures = [f"{name}.png" for name in PICTURES if f'id="figure-{name}"' in text]
    tables = [f"{name}{suffix}" for name in TABLES for suffix in SUFFIXES if f"<dt>{name}{suffix}</dt>" in text]
    for name in (*pictures, *tables):
        (page.parent / name).unlink(missing_ok=True)
