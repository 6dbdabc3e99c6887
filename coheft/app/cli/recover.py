"""The command that saves recordings that were not finished."""

from __future__ import annotations

from coheft.app.cli.base import EVALUATE, FileTarget, Flag, GivenPath, app


@app.command(group=EVALUATE)
def recover(recording: GivenPath, *, output: FileTarget = None, overwrite: Flag = False) -> None:
    """Save what there is of a recording whose run was killed.

    Parameters
    ----------
    recording:
        The .mcap file; it stays as it is.
    output:
        Where to; by default NAME-recovered.mcap beside it.
    overwrite:
        Replace the output if it is there already.
    """
    from coheft.app.recording.recover import recover as recover_file

    target = output if output is not None else recording.parent / f"{recording.stem}-recovered{recording.suffix}"
    saved = recover_file(recording, target, overwrite=overwrite)
    if saved is None:
        print(f"{recording} is complete: nothing to do")
    else:
        print(f"saved {saved.messages} messages, up to {saved.until:.2f} s of the run, as {target}")
