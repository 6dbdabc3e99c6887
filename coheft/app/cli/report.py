"""The command that makes a report from a recording."""

from __future__ import annotations

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, app


@app.command(group=EVALUATE)
def report(recording: options.GivenPath, folder: options.NewFolder) -> None:
    """Make an HTML report from the recording of a run, as 'coheft run --report' does.

    The page, report.html, needs no other file and no network, so it can be shared and archived. Needs
    coheft[record,report].

    Args:
        recording: A recording made by 'coheft run --record'.
        folder: Folder for the page, its pictures and their data.
    """
    from importlib import import_module

    from coheft.app.run.new_folder import gone_if_broken_off

    import_module("coheft.app.recording")  # raises an error that names the missing package, if there is one
    from coheft.app.run_report.of_recording import report_recording

    with gone_if_broken_off(folder):
        page = report_recording(recording, folder)
    print(f"Report: {page}")
