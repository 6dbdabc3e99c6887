"""Export of an identified load to models and arms."""

from pathlib import Path

from coheft.api.result import Result
from coheft.app.export.formats import Limits, Placement, Target, hand_over
from coheft.app.export.found_load import of_recording, of_run, read_load, refuse_estimator
from coheft.app.identify.report import IdentifyReport


def export(
    found: Result | IdentifyReport | str | Path,
    as_: Target,
    *,
    robot: str | None = None,
    estimator: str | None = None,
    flange: Placement | None = None,
    max_mass: float | None = None,
    max_offset: float | None = None,
    max_inertia: float | None = None,
) -> str:
    """Export an identified load for a robot model or an arm controller, as ``coheft export`` does.

    Args:
        found: Result of ``coheft.run``, report of ``coheft.identify``, or the path of a JSON report of either command.
        as_: ``urdf``, ``mjcf``, ``franka``, ``ur``, ``kuka``, or ``verdict`` for JSON with the limits below.
        robot: Robot whose estimate is exported; by default the first.
        estimator: Estimator whose estimate is exported, if several ran side by side; by default the robots' own.
        flange: Pose of the robot's grasp frame in the frame of the flange, or of the model's body: position [m], then
            rotation vector [degrees]. Without it, the frames are assumed to coincide.
        max_mass: Largest allowed mass [kg].
        max_offset: Largest allowed distance of the centre of mass from the flange [m].
        max_inertia: Largest allowed moment of inertia at the centre of mass [kg·m²].

    Raises:
        CoheftError: The load is not valid or not complete, or that estimator did not run; the message says why.
        UsageError: There are limits, but ``as_`` is not ``verdict``; or an estimator, but ``found`` is of a recording.
    """
    if isinstance(found, Result):
        load = of_run(found.report, robot, f"a run of {found.scenario.name}", estimator)
    elif isinstance(found, IdentifyReport):
        refuse_estimator(estimator, found.recording)
        load = of_recording(found, robot, found.recording)
    else:
        load = read_load(Path(found), robot, estimator)
    return hand_over(load, as_, flange, Limits(max_mass, max_offset, max_inertia))[0]
