"""The command that repeats the experiments of the paper on mocobots."""

from typing import Annotated

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, app


def _are_configurations(_: object, text: str) -> None:
    if not text or not set(text) <= set("abcd"):
        raise ValueError(f"expected one or several of the letters abcd; found {text!r}")


@app.command(group=EVALUATE)
def mocobots(
    *,
    experiments: options.Count = 6,
    first: options.Count = 1,
    configurations: Annotated[str, Parameter(validator=_are_configurations)] = "abcd",
    jobs: options.Jobs = None,
    json: options.ReportTarget = None,
    markdown: options.FileTarget = None,
    quiet: options.Quiet = False,
) -> int:
    """Repeat the experiments of Zhang et al. (2025) in simulation, and compare the results with their tables.

    Args:
        experiments: Number of experiments for each configuration, with and without calibration errors; motions
            alternate between via points and a sphere.
        first: Number of the first experiment; each number has its own motions, noise and robots.
        configurations: Which of the paper's configurations to run.
        markdown: Write the tables to this file, with the worst errors in brackets.
    """
    from functools import partial

    from rich.console import Console

    from coheft.app.mocobots.campaign import experiments_in, run_campaign
    from coheft.app.mocobots.tables import markdown as tables
    from coheft.app.mocobots.tables import print_tables, worse_than_paper
    from coheft.app.outputs import write_outputs, write_text
    from coheft.app.results.report import write_report
    from coheft.app.terminal.progress import show_progress

    options.check_outputs(json=json, markdown=markdown)
    chosen = sorted(set(configurations))
    console = Console(stderr=json == "-", quiet=quiet)
    with show_progress(console, "experiments", experiments_in(chosen, experiments)) as progress:
        found = run_campaign(chosen, range(first, first + experiments), jobs, progress)
    print_tables(console, found)
    worse = worse_than_paper(found, "calibration", "pose")
    console.print(f"With calibration errors, worse than the paper: {'; '.join(worse) or 'no row'}.")
    write_outputs((json, partial(write_report, found)), (markdown, lambda path: write_text(path, tables(found))))
    return EXIT_CONVERGED
