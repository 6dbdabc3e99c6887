"""Figures 4 to 6 of Aguilera et al., redrawn."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from coheft.app.cart.campaign import Outcome
from coheft.app.cart.table_one import QUIET_TESTS
from coheft.app.figures import figure_to

_SIZE = (7.0, 4.2)


def draw(outcomes: Sequence[Outcome], folder: Path) -> list[Path]:
    """Draw the figures into an existing folder, with the first run of each test; return the files."""
    learned: dict[int, Outcome] = {}
    fixed: dict[int, Outcome] = {}
    for outcome in outcomes:
        (learned if outcome.case.scenario.learns else fixed).setdefault(outcome.case.test, outcome)
    quiet = [learned[test] for test in QUIET_TESTS if test in learned]
    rest = [outcome for test, outcome in learned.items() if test not in QUIET_TESTS]
    paths = [folder / "fig4-tracking.png"]
    _draw_tracking(learned, fixed, paths[0])
    for shown, name, limits in ((quiet, "fig5-mass", (5.0, 32.0)), (rest, "fig6-mass-noise-and-changes", (5.0, 45.0))):
        if shown:
            paths.append(folder / f"{name}.png")
            _draw_masses(shown, paths[-1], limits)
    return paths


def _draw_tracking(learned: dict[int, Outcome], fixed: dict[int, Outcome], path: Path) -> None:
    from matplotlib import colormaps

    with figure_to(path, *_SIZE) as figure:
        axes = figure.subplots()
        for test, outcome in fixed.items():
            label = "without the estimator" if test == min(fixed) else None
            axes.plot(outcome.times, outcome.tracking_errors, color="0.7", linestyle="--", linewidth=1, label=label)
        colours: Any = colormaps["tab20"]
        axes.set_prop_cycle(color=colours.colors[::2] + colours.colors[1::2])  # as many as there are tests
        for test, outcome in learned.items():
            axes.plot(outcome.times, outcome.tracking_errors, linewidth=1, label=f"test {test}")
        axes.set_ylim(0.0, 0.5)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("distance from the path [m]")
        axes.legend(ncols=3)


def _draw_masses(outcomes: Sequence[Outcome], path: Path, limits: tuple[float, float]) -> None:
    with figure_to(path, *_SIZE) as figure:
        axes = figure.subplots()
        for outcome in outcomes:
            times, masses, deviations = outcome.masses.T
            (line,) = axes.plot(times, masses, linewidth=1, label=f"test {outcome.case.test}")
            low, high = masses - 2 * deviations, masses + 2 * deviations
            axes.fill_between(times, low, high, color=line.get_color(), alpha=0.15)
            axes.plot(outcome.times, outcome.true_masses, color="black", linewidth=0.8, linestyle=":")
        axes.set_ylim(*limits)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("mass [kg]; shaded: ± 2 own std")
        axes.legend(ncols=2)
