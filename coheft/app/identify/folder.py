"""A folder with all about an identification: report, tables as text, pictures of residuals, forces and correlations."""

from pathlib import Path

import numpy as np
from rich.console import Console

from coheft.app.figures import figure_to
from coheft.app.identify.report import IdentifyReport
from coheft.app.identify.tables import print_identification
from coheft.app.results.report import write_report
from coheft.errors import RecordingError, file_errors
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.recording import Recording

_AXES = ("x", "y", "z")


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
    _plot_residuals(found, folder / "residuals.png")
    _plot_forces(recording, found, folder / "forces.png")
    _plot_uncertainty(report, folder / "correlations.png")


def _plot_residuals(found: Identification, path: Path) -> None:
    with figure_to(path, 9.0, 4.5) as figure:
        width = found.residual.shape[1]
        parts = [("force [N]", slice(0, 3)), ("torque [N·m]", slice(width - 3, width))][-(width // 3) :]
        grid = np.atleast_1d(figure.subplots(len(parts), 1, sharex=True))
        for axes, (label, part) in zip(grid, parts, strict=True):
            for name, values in zip(_AXES, found.residual[:, part].T, strict=True):
                axes.plot(found.time, values, linewidth=0.6, label=name)
            axes.set_ylabel(label)
        grid[0].set_title("Residual of the rigid body model")
        grid[0].legend(loc="upper right", ncols=3)
        grid[-1].set_xlabel("hold" if found.method == "static" else "time [s]")


def _plot_forces(recording: Recording, found: Identification, path: Path) -> None:
    """Forces of all robots over time, and when the load was held still."""
    with figure_to(path, 9.0, 1.6 * len(found.names) + 0.8) as figure:
        grid = np.atleast_1d(figure.subplots(len(found.names), 1, sharex=True))
        every = max(1, len(recording.time) // 5000)
        for axes, name, wrench in zip(grid, found.names, recording.stacked("wrench"), strict=True):
            for axis, values in zip(_AXES, wrench[::every, :3].T, strict=True):
                axes.plot(recording.time[::every], values, linewidth=0.5, label=axis)
            for start, end in () if found.holds is None else found.holds.spans:
                axes.axvspan(start, end, color="grey", alpha=0.25)
            axes.set_ylabel(f"{name} [N]")
        grid[0].set_title("Forces on the load" + ("" if found.holds is None else "; grey: held still"))
        grid[0].legend(loc="upper right", ncols=3)
        grid[-1].set_xlabel("time [s]")


def _plot_uncertainty(report: IdentifyReport, path: Path) -> None:
    covariance = np.array(report.payload.covariance)
    spread = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    names = ["m", "hx", "hy", "hz", "Jxx", "Jyy", "Jzz", "Jxy", "Jxz", "Jyz"]
    with figure_to(path, 5.2, 4.4) as figure:
        axes = figure.subplots()
        image = axes.imshow(covariance / np.outer(spread, spread), vmin=-1.0, vmax=1.0, cmap="RdBu")
        axes.set_xticks(range(10), names)
        axes.set_yticks(range(10), names)
        axes.grid(visible=False)
        axes.set_title("Correlation of the estimates")
        figure.colorbar(image)
