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
    """Identify a load from a recording: where the robots held it, its mass, centre of mass and inertia.

    Exit status 0 if everything was identified; 3 if something is not observable, or if the numbers should not be
    trusted, and the report says why. A recording that cannot be of one load, for instance because forces have the wrong
    sign, is an error.

    Parameters
    ----------
    recording:
        An .npz file, or a folder with a CSV file per robot, as 'coheft run --save-data' makes; an MCAP file, as 'coheft
        run --record' makes, or a bag of ROS; see docs/data-format.md.
    method:
        batch: the least squares of Fan et al.; instruments: the same without their bias; pose: from poses, without
        differentiating them; likelihood: maximum likelihood, for sensors of known noise; static: from a load that is
        held still. By default the best one that the recording allows.
    calibrate:
        Estimate calibration errors of the robots as well (method pose).
    from_:
        Ignore everything before this time [s].
    to:
        Ignore everything after this time [s].
    cutoff:
        Cutoff of the low-pass filter [Hz]: by default 5 for batch, otherwise 3; likelihood has none.
    assume:
        Correct the recording for this fault before identifying the load; the fault is named as in the report's verdict,
        for instance 'offset' or 'sensor turned'.
    topics:
        Topics of each robot in an MCAP file or a bag, for instance left=/left/wrench left=/left/pose
        right=/right/wrench right=/right/pose. By default the first part of a topic's name is the robot.
    holds:
        Recording of the same load held still in several orientations by the same robots; improves mass and centre of
        mass.
    json:
        Write the report to this file; - for standard output.
    report:
        Folder for a report with pictures.
    quiet:
        Print only errors.
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
