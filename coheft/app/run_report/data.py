"""The data behind the pictures, as tables for other programs: Parquet where pyarrow is installed, CSV elsewhere."""

import csv
from collections.abc import Iterator
from importlib.util import find_spec
from math import isfinite
from pathlib import Path

from coheft.app.results.points import Point
from coheft.app.run_report.series import Series
from coheft.estimation.geometry.spatial import Array

Row = dict[str, float | str | bool | None]
PAYLOAD_COLUMNS = (
    *("mass_kg", "com_x_m", "com_y_m", "com_z_m"),
    *(f"inertia_{axes}_kgm2" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")),
)
"""Columns of ``(m, h, J packed)``."""
_WRENCH = ("force_x_n", "force_y_n", "force_z_n", "torque_x_nm", "torque_y_nm", "torque_z_nm")
_POSE = ("rotation_x_rad", "rotation_y_rad", "rotation_z_rad", "x_m", "y_m", "z_m")

TABLES = {
    "estimates": "each robot's estimate of the payload in its own frame, with the truth; the total wrench",
    "poses": "errors of the neighbours' grasp poses, and their standard deviations",
    "states": "what each robot reported to know and not to know, from when to when",
    "load-changes": "every report of every robot around changes of the load",
    "pace": "simulated time, and the clock on the wall",
}


def write_data(series: Series, folder: Path) -> list[Path]:
    """Write the tables into a folder; return the files, those of empty tables left out."""
    points = [
        (name, point)
        for robots in series.by_estimator.values()
        for name, robot in robots.items()
        for point in robot.points
    ]
    tables: dict[str, list[Row]] = {
        "estimates": [_estimate(name, point) for name, point in points],
        "poses": [row for name, point in points for row in _poses(name, point)],
        "states": list(_states(series)),
        "load-changes": [
            {"load_change_s": close_up.at, **_estimate(name, point)}
            for close_up in series.close_ups
            for name, points in close_up.points.items()
            for point in points
        ],
        "pace": [{"time_s": time, "wall_s": wall} for time, wall in series.pace],
    }
    write = _write_parquet if find_spec("pyarrow") is not None else _write_csv
    return [write(rows, folder / name) for name, rows in tables.items() if rows]


def _estimate(robot: str, point: Point) -> Row:
    return {
        "robot": robot,
        "estimator": point.estimator,
        "time_s": point.time,
        "block": point.block,
        "stale": point.is_stale,
        **_columns("true_", PAYLOAD_COLUMNS, point.truth),
        **_columns("", PAYLOAD_COLUMNS, point.truth - point.error),
        **_columns("std_", PAYLOAD_COLUMNS, point.std),
        **_columns("true_total_", _WRENCH, point.total),
        **_columns("total_", _WRENCH, point.total + point.residual),
    }


def _poses(robot: str, point: Point) -> Iterator[Row]:
    for neighbour, (error, std) in point.poses.items():
        yield {
            "robot": robot,
            "neighbour": neighbour,
            "estimator": point.estimator,
            "time_s": point.time,
            "stale": point.is_stale,
            **_columns("error_", _POSE, error),
            **_columns("std_", _POSE, std),
        }


def _states(series: Series) -> Iterator[Row]:
    for name, robot in series.robots.items():
        for span in robot.spans:
            yield {
                "robot": name,
                "from_s": span.start,
                "to_s": span.end,
                "state": span.state,
                "not_observable": "; ".join(span.not_observable),
                "reasons": "; ".join(span.reasons),
            }


def _columns(prefix: str, names: tuple[str, ...], values: Array) -> Row:
    """Return the columns of a vector; unknown numbers stay empty."""
    return {
        f"{prefix}{name}": value if isfinite(value) else None
        for name, value in zip(names, values.tolist(), strict=True)
    }


def _write_parquet(rows: list[Row], path: Path) -> Path:
    import pyarrow
    from pyarrow import parquet

    path = path.with_suffix(".parquet")
    parquet.write_table(pyarrow.Table.from_pylist(rows), path, compression="zstd")
    return path


def _write_csv(rows: list[Row], path: Path) -> Path:
    path = path.with_suffix(".csv")
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path
