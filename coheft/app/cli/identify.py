"""The command that identifies a load from a recording."""

import os
from typing import Annotated

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, EXIT_NOT_CONVERGED, app
from coheft.app.identify.choices import Bounds, Method, Options


@app.command(group=EVALUATE)
def identify(
    recording: options.GivenPath,
    *,
    method: Method | None = None,
    calibrate: options.Flag = False,
    bounds: Annotated[Bounds | None, Parameter(name="*")] = None,
    from_: Annotated[float | None, Parameter(name="--from")] = None,
    to: float | None = None,
    cutoff: options.Positive | None = None,
    assume: str | None = None,
    topics: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative_iterable="")] = (),
    holds: options.GivenPath | None = None,
    json: options.ReportTarget = None,
    report: options.FolderTarget = None,
    quiet: options.Quiet = False,
) -> int:
    """Identify a load from a recording: where the robots held it, its mass, centre of mass and inertia.

    Exit status 0 if everything was identified, and nothing in the recording speaks against it; 3 if something is not
    observable, if the numbers should not be trusted, or if nothing could check them, and the report says why. A
    recording that cannot be of one load, for instance because forces have the wrong sign, is an error.

    Args:
        recording: An .npz file, or a folder with a CSV file per robot, as 'coheft run --save-data' makes; an MCAP file,
            as 'coheft run --record' makes, or a bag of ROS; see docs/data-format.md.
        method: batch: the least squares of Zhang et al.; instruments: the same without their bias; pose: from poses,
            without differentiating them; likelihood: maximum likelihood, for sensors of known noise; static: from a
            load that is held still. By default the best one that the recording allows.
        calibrate: Estimate calibration errors of the robots as well (method pose).
        from_: Ignore everything before this time [s].
        to: Ignore everything after this time [s].
        cutoff: Cutoff of the low-pass filter [Hz]: by default 5 for batch, otherwise 3, or 6 or 12 if the motion is
            fast; likelihood has none.
        assume: Correct the recording for this fault before identifying the load; the fault is named as in the report's
            verdict, for instance 'offset' or 'sensor turned'.
        topics: Topics of each robot in an MCAP file or a bag, for instance left=/left/wrench left=/left/pose
            right=/right/wrench right=/right/pose. By default the first part of a topic's name is the robot.
        holds: Recording of the same load held still in several orientations by the same robots; improves mass and
            centre of mass.
        report: Folder for a report with pictures.
    """
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small, so that more threads only cost time

    from functools import partial

    from rich.console import Console

    from coheft.app.figures import picture_folder
    from coheft.app.identify.folder import write_identification
    from coheft.app.identify.methods import evaluate, files_of
    from coheft.app.identify.report import make_report
    from coheft.app.identify.tables import print_identification
    from coheft.app.outputs import write_outputs
    from coheft.app.results.report import write_report

    options.check_outputs(*files_of(recording), *(files_of(holds) if holds else ()), json=json, report=report)
    with picture_folder(report):
        how = Options(
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
        recorded, found = evaluate(recording, how)
    result = make_report(str(recording), recorded, found)
    print_identification(Console(stderr=json == "-", quiet=quiet), result)
    write_outputs(
        (json, partial(write_report, result)),
        (report, lambda folder: write_identification(folder, recorded, found, result)),
    )
    is_accepted = not (result.not_observable or result.doubts or result.not_judged)
    return EXIT_CONVERGED if is_accepted else EXIT_NOT_CONVERGED
