"""The result of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coheft.api.tracks import RobotResult
from coheft.app.results.report import LoadChangeReport, Report
from coheft.errors import MissingPackageError
from coheft.estimation.rigid_body.mass_properties import pack_symmetric
from coheft.wire.scenario.schema import Scenario

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The result of a run.

    Attributes:
        scenario: The scenario that was run.
        robots: Estimates of each robot over time, by name.
        report: The state at the end, and events, as written by ``coheft run --json``.
        beside: Results of the estimators that ran beside the robots' own, by name; ``save`` leaves them out.
    """

    scenario: Scenario
    robots: Mapping[str, RobotResult]
    report: Report
    beside: Mapping[str, Result] = field(default_factory=dict)

    def __repr__(self) -> str:
        report, converged = self.report, "converged" if self.converged else "not converged"
        run = f"{report.scenario}, {report.duration_s:g} s, {len(self.robots)} robots, {converged}"
        return f"Result({run}; attributes: scenario, robots, report, beside)"

    @property
    def converged(self) -> bool:
        """Whether every robot ended with a valid, converged estimate."""
        return self.report.converged

    @property
    def load_changes(self) -> list[LoadChangeReport]:
        """Changes of the payload: when each occurred, when the last robot noticed it, and when all had recovered."""
        return self.report.load_changes

    def plot(self) -> Any:
        """Plot mass, and errors of centre of mass and inertia, of all robots over time.

        Returns:
            Three axes of matplotlib, in an array; ``result.plot()[0].figure.savefig("run.png")`` writes them.

        Raises:
            MissingPackageError: matplotlib is not installed.
        """
        from coheft.api.plots import plot_result

        return plot_result(self)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return a table with a row for each estimate of each robot: ``robot``, ``time_s``, ``state``, ``valid``, then
        numbers.

        Columns of numbers are ``mass_kg``, ``com_x_m``, …, ``inertia_xx_kgm2``, …; with the prefix ``true_`` the truth,
        with ``std_`` the robot's own standard deviation.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise MissingPackageError("pandas", "frame") from error
        from coheft.app.run_report.data import PAYLOAD_COLUMNS

        tables = []
        for name, robot in self.robots.items():
            columns = {"robot": name, "time_s": robot.time, "state": robot.state, "valid": robot.valid}
            for prefix, part in (("", "estimate"), ("true_", "truth"), ("std_", "std")):
                mass, com, inertia = (getattr(track, part) for track in (robot.mass, robot.com, robot.inertia))
                values = np.column_stack([mass, com, pack_symmetric(inertia)])
                columns |= {f"{prefix}{column}": values[:, k] for k, column in enumerate(PAYLOAD_COLUMNS)}
            tables.append(pandas.DataFrame(columns))
        return pandas.concat(tables, ignore_index=True)

    def save(self, path: str | Path) -> Path:
        """Write the result to an ``.npz`` file, which ``coheft.load`` reads; return its path.

        Raises:
            CoheftError: It cannot be written, or has another suffix.
        """
        from coheft.api.files import save_result

        return save_result(self, Path(path))
