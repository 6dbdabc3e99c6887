"""Colours, fonts and output of the documentation's pictures."""

from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

PICTURES = Path(__file__).with_name("pictures")
ROBOTS = ("#0b62a4", "#d1610c", "#2a8a57", "#8a4fb0", "#c0314f", "#8a7a1f")
AXES = ("#d43b3b", "#2f9e44", "#2f6fde")
"""Colours of x, y and z."""
INK, SOFT, FAINT = "#24292f", "#6b7480", "#d5dae0"

mpl.rcParams.update(
    {
        "font.family": "DejaVu Sans",
        "font.size": 10,
        "axes.edgecolor": SOFT,
        "axes.labelcolor": INK,
        "axes.spines.top": False,
        "axes.spines.right": False,
        "axes.titlelocation": "left",
        "axes.titlesize": 11,
        "axes.grid": True,
        "grid.color": "#eceff2",
        "text.color": INK,
        "xtick.color": SOFT,
        "ytick.color": SOFT,
        "svg.fonttype": "path",  # looks the same everywhere
        "svg.hashsalt": "coheft",  # so that equal pictures are equal files
        "svg.id": "picture",
    }
)


def save(figure: Figure, name: str, folder: Path = PICTURES) -> None:
    """Write a picture to a file name with suffix, without metadata that depend on the time, and print its path."""
    metadata = {"Date": None} if name.endswith(".svg") else {"Software": None}
    figure.savefig(folder / name, dpi=130, facecolor="white", metadata=metadata)
    print(f"Picture: {folder / name}")
