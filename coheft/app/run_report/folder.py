"""A folder with all about a run: the page, its pictures, the data, and the report for programs."""

from __future__ import annotations

import os
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path

from coheft.app.figures import DARK, LIGHT, Theme, figure_to
from coheft.app.results.report import Report, write_report
from coheft.app.run_report.data import write_data
from coheft.app.run_report.former import remove_former
from coheft.app.run_report.page import Drawn, render_page
from coheft.app.run_report.pictures import Picture, pictures_of
from coheft.app.run_report.series import Series, SeriesFollower
from coheft.errors import CoheftError, MissingPackageError
from coheft.wire.scenario.schema import Scenario

PAGE = "report.html"


class ReportPage(SeriesFollower):
    """Follows a run, and then writes everything about it.

    Raises:
        CoheftError: The folder cannot be made.
        MissingPackageError: What draws or writes the page is not installed.
    """

    def __init__(self, folder: Path) -> None:
        prepare_folder(folder)
        self._folder = folder

    def write(self, scenario: Scenario, clock: str, report: Report) -> Path:
        """Write it; return the page.

        Raises:
            CoheftError: It cannot be written.
        """
        return write_folder(self._folder, scenario, clock, self.series, report)


def prepare_folder(folder: Path) -> None:
    """Make the folder, so that a run does not end without one.

    Raises:
        CoheftError: It cannot be made.
        MissingPackageError: What draws or writes the page is not installed.
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
    """Write everything about a run, in place of a former report in the folder; return the page.

    Of a recording no clock is known.

    Raises:
        CoheftError: It cannot be written.
    """
    page = folder / PAGE
    try:
        remove_former(page)
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
    with figure_to(image, *picture.size, theme) as figure:
        picture.draw(figure, theme, series, report)
    return image.getvalue()
