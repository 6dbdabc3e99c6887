"""Style and files of all pictures."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from coheft.errors import CoheftError, file_errors, require_packages

_DPI = 150
_PACKAGES = {"study": ("matplotlib",), "report": ("matplotlib", "Jinja2")}
"""What draws pictures and writes pages, by the extra that installs it."""


@dataclass(frozen=True)
class Theme:
    """Colours of a picture: ``ink`` of text and truth, ``accent`` of the main curve, ``series`` of several curves."""

    paper: str
    ink: str
    muted: str
    grid: str
    accent: str
    warning: str
    series: tuple[str, ...]

    def of_curve(self, index: int) -> str:
        """Return the colour of one of several curves; colours repeat."""
        return self.series[index % len(self.series)]


LIGHT = Theme(
    paper="#ffffff",
    ink="#1f2933",
    muted="#66717e",
    grid="#e4e8ec",
    accent="#0b62a4",
    warning="#c45a00",
    series=("#0b62a4", "#c45a00", "#1b8a5a", "#a3348a", "#b58900", "#3aa6c9", "#7a5bd0", "#8c564b"),
)
DARK = Theme(
    paper="#171c23",
    ink="#e4e8ec",
    muted="#98a3af",
    grid="#2d353f",
    accent="#5cadf0",
    warning="#f0914a",
    series=("#5cadf0", "#f0914a", "#4cc38a", "#e07bcb", "#e3c04b", "#6fd3ee", "#a993f5", "#c99a8c"),
)


@contextmanager
def picture_folder(folder: Path | None, extra: str = "study") -> Iterator[None]:
    """Make a folder for pictures, with its parents, before anything that takes long; None: there are no pictures.

    What has been made is removed again, as far as it is empty, if an error or Ctrl-C ends the context. ``extra`` is the
    one that installs what writes into the folder.

    Raises:
        CoheftError: It cannot be made.
        MissingPackageError: A package that writes into it is not installed.
    """
    if folder is None:
        yield
        return
    require_packages(extra, *_PACKAGES[extra])
    new = [each for each in (folder, *folder.parents) if not each.exists()]
    with file_errors(CoheftError, f"cannot make the folder {folder}", "; name another"):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        yield
    except BaseException:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        raise


@contextmanager
def figure_to(target: Path | IO[bytes], width: float, height: float, theme: Theme = LIGHT) -> Iterator[Any]:
    """Yield a figure of a size [inches] to draw into; at the end of the context it is written as PNG.

    ``picture_folder`` has checked that the plotting package is installed.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(settings_of(theme)):
        figure = Figure(figsize=(width, height), layout="constrained")
        yield figure
        figure.savefig(target, dpi=_DPI, format="png")


def settings_of(theme: Theme) -> dict[str, Any]:
    """Return matplotlib's settings for pictures of a theme."""
    from matplotlib.rcsetup import cycler

    return {
        "figure.facecolor": theme.paper,
        "savefig.facecolor": theme.paper,
        "axes.facecolor": theme.paper,
        "axes.edgecolor": theme.muted,
        "axes.labelcolor": theme.ink,
        "axes.titlecolor": theme.ink,
        "axes.prop_cycle": cycler(color=theme.series),
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.linewidth": 0.8,
        "axes.grid": True,
        "axes.axisbelow": True,
        "axes.titlesize": 10,
        "axes.labelsize": 9,
        "grid.color": theme.grid,
        "grid.linewidth": 0.7,
        "text.color": theme.ink,
        "xtick.color": theme.muted,
        "ytick.color": theme.muted,
        "xtick.labelsize": 8,
        "ytick.labelsize": 8,
        "xtick.minor.visible": False,
        "legend.frameon": False,
        "legend.fontsize": 8,
        "legend.labelcolor": theme.ink,
        "lines.linewidth": 1.3,
        "lines.solid_capstyle": "round",
    }
