"""A result as a pandas table."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from coheft.api.result import Result
from coheft.api.tracks import RobotResult
from coheft.app.run_report.data import PAYLOAD_COLUMNS
from coheft.errors import MissingPackageError
from coheft.estimation.rigid_body.mass_properties import pack_symmetric

if TYPE_CHECKING:
    import pandas


def dataframe_of(result: Result) -> pandas.DataFrame:
    """See ``Result.to_dataframe``."""
    try:
        import pandas
    except ImportError as error:
        raise MissingPackageError("pandas", "frame") from error
    return pandas.concat([_of_robot(name, robot) for name, robot in result.robots.items()], ignore_index=True)


def _of_robot(name: str, robot: RobotResult) -> pandas.DataFrame:
    import pandas

    columns = {"robot": name, "time_s": robot.time, "state": robot.state, "valid": robot.valid}
    for prefix, part in (("", "estimate"), ("true_", "truth"), ("std_", "std")):
        mass, com, inertia = (getattr(track, part) for track in (robot.mass, robot.com, robot.inertia))
        values = np.column_stack([mass, com, pack_symmetric(inertia)])
        columns |= {f"{prefix}{column}": values[:, k] for k, column in enumerate(PAYLOAD_COLUMNS)}
    return pandas.DataFrame(columns)
