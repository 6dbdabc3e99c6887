"""Commands for recordings of runs."""

from math import isfinite

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, app


@app.command(group=EVALUATE)
def recover(
    recording: options.GivenPath, *, output: options.FileTarget = None, overwrite: options.Flag = False
) -> None:
    """Save the intact part of a recording that is damaged, or whose run was killed.

    Args:
        recording: The .mcap file; it is not changed.
        output: File to write; by default NAME-recovered.mcap beside it.
        overwrite: Replace the output file if it exists.
    """
    from coheft.app.recording.recover import recover as recover_file

    target = output if output is not None else recording.parent / f"{recording.stem}-recovered{recording.suffix}"
    saved = recover_file(recording, target, overwrite=overwrite)
    if saved is None:
        print(f"{recording} is complete and undamaged: nothing to do")
        return
    print(f"saved {saved.messages} messages, up to {saved.until:.2f} s of the run, as {target}")
    for lost in saved.lost:
        span = " and ".join(f"{time:.2f} s" for time in (lost.after, lost.before) if isfinite(time))
        when = "between" if " and " in span else "after" if isfinite(lost.after) else "before"
        print(f"lost {lost.end - lost.start} bytes, from byte {lost.start} on: messages {when} {span}")
    if saved.nameless:
        print(f"lost {saved.nameless} messages whose topics are unknown")


@app.command(group=EVALUATE)
def report(recording: options.GivenPath, folder: options.NewFolder) -> None:
    """Make an HTML report from the recording of a run, as 'coheft run --report' does.

    The page, report.html, needs no other file and no network, so it can be shared and archived. Needs
    coheft[record,report].

    Args:
        recording: A recording made by 'coheft run --record'.
        folder: Folder for the page, its pictures and their data.
    """
    from coheft.app.run_report.of_recording import report_recording

    print(f"Report: {report_recording(recording, folder)}")
