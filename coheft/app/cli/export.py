"""The command that exports an identified load."""

import sys
from typing import Annotated, Literal

from cyclopts import Parameter

from coheft.app.cli import options
from coheft.app.cli.base import EVALUATE, EXIT_CONVERGED, EXIT_NOT_CONVERGED, app
from coheft.errors import UsageError

_Pose = Annotated[tuple[float, float, float, float, float, float], Parameter(negative=())]


@app.command(group=EVALUATE)
def export(
    report: options.GivenPath | None = None,
    *,
    as_: Annotated[Literal["urdf", "mjcf", "franka", "ur", "kuka", "verdict"], Parameter(name="--as")],
    robot: str | None = None,
    estimator: str | None = None,
    flange: _Pose | None = None,
    max_mass: options.Positive | None = None,
    max_offset: options.Positive | None = None,
    max_inertia: options.Positive | None = None,
    to: options.FileTarget = None,
    run: options.ShownRun = None,
) -> int:
    """Export an identified load to a robot model, an arm controller, or a check of whether it may be lifted.

    The export describes the whole load, for an arm that holds it alone. An estimate that is not valid or not complete
    is refused with the reason. Exit status 3 if the load is not certain to be within the limits.

    Args:
        report: Report written by 'coheft run --json' or 'coheft identify --json'; without it, ask a run in progress.
        as_: urdf, mjcf: the element <inertial>; franka: setLoad of libfranka; ur: set_target_payload of URScript; kuka:
            LOAD_DATA of KRL; verdict: JSON with the load and its limits.
        robot: Robot whose estimate is exported; by default the first.
        estimator: Estimator whose estimate is exported, if several run side by side; by default the robots' own, which
            was named first.
        flange: Pose of the robot's grasp frame in the frame of the flange, or of the model's body: position x y z [m],
            then rotation vector x y z [degrees]. Without it, the frames are assumed to coincide.
        max_mass: With verdict: largest allowed mass [kg].
        max_offset: With verdict: largest allowed distance of the centre of mass from the flange [m].
        max_inertia: With verdict: largest allowed moment of inertia at the centre of mass [kg·m²].
        to: Write to this file instead of standard output.
    """
    from coheft.app.export.formats import Limits, hand_over
    from coheft.app.export.found_load import load_of_run, read_load
    from coheft.app.outputs import write_text

    if report is not None and run is not None:
        raise UsageError(f"--run names a run in progress, but {report} is a report: leave one out")
    options.check_outputs(*([] if report is None else [report]), to=to)
    load = read_load(report, robot, estimator) if report is not None else load_of_run(run, robot, estimator)
    text, answer = hand_over(load, as_, flange, Limits(max_mass, max_offset, max_inertia))
    if to is None:
        sys.stdout.write(text)
    else:
        write_text(to, text)
    return EXIT_CONVERGED if answer == "within" else EXIT_NOT_CONVERGED
