"""The command that redoes the paper on mocobots."""

from __future__ import annotations

from itertools import count
from typing import Annotated

from cyclopts import Parameter

from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, Count, FileTarget, Flag, ReportTarget, app, check_outputs


def _are_configurations(_: object, text: str) -> None:
    if not text or not set(text) <= set("abcd"):
        raise ValueError(f"expected some of abcd; found {text!r}")


@app.command(group=EVALUATE)
def mocobots(
    *,
    experiments: Count = 6,
    first: Count = 1,
    configurations: Annotated[str, Parameter(validator=_are_configurations)] = "abcd",
    jobs: Count | None = None,
    json: ReportTarget = None,
    markdown: FileTarget = None,
    quiet: Flag = False,
) -> int:
    """Repeat the experiments of Zhang et al. (2025) in simulation, and compare the results with their tables.

    Parameters
    ----------
    experiments:
        Number of experiments for each configuration, with and without calibration errors; motions alternate between via
        points and a sphere.
    first:
        Number of the first experiment; each number has its own motions, noise and robots.
    configurations:
        Which of the paper's configurations to run.
    jobs:
        Number of processes; by default one per core.
    json:
        Write all errors to this file; - for standard output.
    markdown:
        Write the tables to this file.
    quiet:
        Print only errors.
    """
    from rich.console import Console

    from coheft.app.mocobots.campaign import experiments_in, run_campaign
    from coheft.app.mocobots.tables import markdown as tables
    from coheft.app.mocobots.tables import worse_than_paper
    from coheft.app.results.report import write_report
    from coheft.app.terminal.progress import show_progress

    check_outputs(json=json, markdown=markdown)
    chosen = sorted(set(configurations))
    console = Console(stderr=json == "-")
    done = count(1)
    with show_progress(console, "experiments", experiments_in(chosen, experiments), quiet=quiet) as told:
        found = run_campaign(chosen, range(first, first + experiments), jobs, lambda: told(next(done), ""))
    text = tables(found)
    if not quiet:
        console.print(text, markup=False, soft_wrap=True)
        worse = worse_than_paper(found, "calibration", "pose")
        console.print(f"With calibration errors, worse than the paper: {'; '.join(worse) or 'no row'}.")
    try:
        if json is not None:
            write_report(found, json)
    finally:  # if one of them cannot be written, the other may
        if markdown is not None:
            markdown.write_text(text, encoding="utf-8")
    return EXIT_CONVERGED
