"""The folder of a report: the page, its pictures, the data, and the report for programs."""

from io import BytesIO
from pathlib import Path

from coheft.app.figures import DARK, LIGHT, Theme, figure_to
from coheft.app.results.report import Report, write_report
from coheft.app.run_report.data import write_data
from coheft.app.run_report.drawings import Picture, pictures_of
from coheft.app.run_report.page import render_page
from coheft.app.run_report.series import Series
from coheft.errors import CoheftError, file_errors
from coheft.wire.scenario.schema import Scenario

PAGE = "report.html"
_WIDTH = 10.0  # [inches]


def write_folder(folder: Path, scenario: Scenario, clock: str | None, series: Series, report: Report) -> Path:
    """Write a report into a folder that exists, in place of a former one; return the path of the page.

    ``clock`` is None for a recording. A ``CoheftError`` says what cannot be written.
    """
    page = folder / PAGE
    with file_errors(CoheftError, f"cannot write the report into {folder}"):
        _remove_former(page)
        write_report(report, str(folder / "report.json"))
        data = write_data(series, folder)
        drawn = []
        for picture in pictures_of(series, report):
            light, dark = (_draw(picture, theme, series, report) for theme in (LIGHT, DARK))
            (folder / f"{picture.name}.png").write_bytes(light)
            drawn.append((picture, light, dark))
        page.write_text(render_page(scenario, clock, series, report, drawn, data), encoding="utf-8")
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
    marks = {".png": 'id="figure-{0.stem}"', ".parquet": "<dt>{0.name}</dt>", ".csv": "<dt>{0.name}</dt>"}
    for file in page.parent.iterdir():
        if file.suffix in marks and marks[file.suffix].format(file) in text:
            file.unlink()
