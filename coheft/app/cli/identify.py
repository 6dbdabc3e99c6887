"""The command that finds a load from a recording."""

from __future__ import annotations

from typing import Annotated

from cyclopts import Parameter

from coheft.app.cli.base import (
    EVALUATE,
    EXIT_CONVERGED,
    EXIT_NOT_CONVERGED,
    Flag,
    FolderTarget,
    GivenPath,
    Positive,
    ReportTarget,
    app,
    check_outputs,
)
from coheft.app.identify.choices import Bounds, Method
from coheft.errors import RecordingError, UsageError


@app.command(group=EVALUATE)
def identify(
    recording: GivenPath,
    *,
    method: Method | None = None,
    calibrate: Flag = False,
    bounds: Annotated[Bounds | None, Parameter(name="*")] = None,
    from_: Annotated[float | None, Parameter(name="--from")] = None,
    to: float | None = None,
    cutoff: Positive | None = None,
    assume: str | None = None,
    topics: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative_iterable="")] = (),
    holds: GivenPath | None = None,
    json: ReportTarget = None,
    report: FolderTarget = None,
    quiet: Flag = False,
) -> int:
    """Find out from a recording where the robots held the load, and its mass, centre of mass and inertia.

    Exit status 0 if the motion shows everything, 3 if it does not, or if something speaks against what it shows: then
    the report says what. What cannot be a recording of one load, as with forces of the wrong sign, is an error.

    Parameters
    ----------
    recording:
        An .npz file, or a folder with a CSV file per robot, as 'coheft run --save-data' makes; an MCAP file, as 'coheft
        run --record' makes, or a bag of ROS; see docs/data-format.md.
    method:
        batch: the paper's least squares; instruments: without their bias; pose: grasps from poses, with nothing
        differentiated; likelihood: for sensors of known noise; static: from a load that is held still. Without it:
        what suits the recording best.
    calibrate:
        The robots are not well calibrated; estimate what is wrong with them as well (method pose).
    from_:
        Leave out what was before [s].
    to:
        Leave out what came after [s].
    cutoff:
        Of the low-pass filter [Hz]; 5 for batch, else 3; likelihood has none.
    assume:
        What is wrong with the recording, by the name that its verdict has, for instance 'offset' or 'sensor turned': it
        is taken out, and what is left is identified (method pose).
    topics:
        Of an MCAP file or a bag: which are of which robot, as left=/left/wrench left=/left/pose right=/right/wrench
        right=/right/pose. Without it, robots are what topics' names begin with.
    holds:
        Recording of the same load, held still in some orientations by the same robots: for mass and centre of mass.
    json:
        Write the report to this file; - for standard output.
    report:
        Folder for a report with pictures.
    quiet:
        Show nothing but errors.
    """
    from rich.console import Console

    from coheft.app.figures import make_folder
    from coheft.app.identify.folder import write_identification
    from coheft.app.identify.inputs import files_of, read_any, read_holds
    from coheft.app.identify.methods import identify as find
    from coheft.app.identify.methods import part_of
    from coheft.app.identify.report import make_report
    from coheft.app.identify.tables import print_identification
    from coheft.app.results.report import write_report
    from coheft.app.run.new_folder import gone_if_broken_off
    from coheft.estimation.batch.statics import Statics

    if bounds is not None and not calibrate:
        raise UsageError("bounds are of errors that --calibrate estimates: add it, or leave them out")
    check_outputs(*files_of(recording), *(files_of(holds) if holds else ()), json=json, report=report)
    if method == "static" and (holds is not None or from_ is not None or to is not None):
        raise UsageError("--method static takes all holds of RECORDING: leave --holds, --from and --to out")
    statics: Statics | None = None
    if method == "static" and not topics:
        statics = read_holds(recording)
        recorded = statics.as_recording()
    else:
        recorded = read_any(recording, topics)
    if holds is not None:
        statics = read_holds(holds, recorded.names)
    try:
        recorded = part_of(recorded, from_, to)
        with gone_if_broken_off(report):
            if report is not None:
                make_folder(report)
            found = find(recorded, method, (bounds or Bounds()) if calibrate else None, cutoff, statics, assume)
    except RecordingError as error:
        raise RecordingError(f"{recording}: {error}") from error
    result = make_report(str(recording), recorded, found)
    if not quiet:
        print_identification(Console(stderr=json == "-"), result)
    try:
        if json is not None:
            write_report(result, json)
    finally:  # if one of them cannot be written, the other may
        if report is not None:
            write_identification(report, recorded, found, result)
    return EXIT_NOT_CONVERGED if result.not_observable or result.doubts else EXIT_CONVERGED
