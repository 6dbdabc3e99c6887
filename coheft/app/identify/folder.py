"""A folder with all about an identification: report, tables as text, pictures."""

from pathlib import Path

from rich.console import Console

from coheft.app.identify.plots import plot_forces, plot_residuals, plot_uncertainty
from coheft.app.identify.report import IdentifyReport
from coheft.app.identify.tables import print_identification
from coheft.app.results.report import write_report
from coheft.errors import RecordingError, file_errors
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording


def write_identification(folder: Path, recording: Recording, found: Identification, report: IdentifyReport) -> None:
    """Write ``report.json``, ``report.txt`` and pictures into an existing folder.

    Raises:
        RecordingError: A file cannot be written.
        MissingPackageError: matplotlib is not installed.
    """
    with (
        file_errors(RecordingError, f"{folder}: cannot be written"),
        (folder / "report.txt").open("w", encoding="utf-8") as file,
    ):
        print_identification(Console(file=file, width=120), report)
    write_report(report, str(folder / "report.json"))
    plot_residuals(found, folder / "residuals.png")
    plot_forces(recording, found, folder / "forces.png")
    plot_uncertainty(report, folder / "correlations.png")
