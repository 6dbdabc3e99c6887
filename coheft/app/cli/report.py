"""The command that makes a page of a recording."""

from __future__ import annotations

from coheft.app.cli.base import EVALUATE, GivenPath, NewFolder, app


@app.command(group=EVALUATE)
def report(recording: GivenPath, folder: NewFolder) -> None:
    """Make a page with the scene, pictures and data of a run that was recorded, as 'coheft run --report' does.

    The page, report.html, needs no other file and no network: it can be sent and kept. Takes coheft[record,report].

    Parameters
    ----------
    recording:
        What 'coheft run --record' has written.
    folder:
        Where the page, its pictures and the data go.
    """
    from importlib import import_module

    from coheft.app.run.new_folder import gone_if_broken_off

    import_module("coheft.app.recording")  # says which package is missing, if one is
    from coheft.app.run_report.of_recording import report_recording

    with gone_if_broken_off(folder):
        page = report_recording(recording, folder)
    print(f"Report: {page}")
