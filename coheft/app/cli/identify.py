"""The command that finds a load from a recording."""

from __future__ import annotations

import os
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
from coheft.app.identify.choices import Bounds, Method, Options


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
        is taken out, and what is left is identified.
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
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small: more threads only wait for each other

    from rich.console import Console

    from coheft.app.figures import make_folder
    from coheft.app.identify.evaluate import evaluate
    from coheft.app.identify.folder import write_identification
    from coheft.app.identify.inputs import files_of
    from coheft.app.identify.report import make_report
    from coheft.app.identify.tables import print_identification
    from coheft.app.results.report import write_report
    from coheft.app.run.new_folder import gone_if_broken_off

    check_outputs(*files_of(recording), *(files_of(holds) if holds else ()), json=json, report=report)
    with gone_if_broken_off(report):
        if report is not None:
            make_folder(report)
        options = Options(
            method=method,
            calibrate=calibrate,
            bounds=bounds,
            from_=from_,
            to=to,
            cutoff=cutoff,
            assume=assume,
            topics=topics,
            holds=holds,
        )
        recorded, found = evaluate(recording, options)
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
