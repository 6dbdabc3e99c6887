"""Files of results: arrays in an ``.npz`` file that also holds scenario and report as JSON."""

import zipfile
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from coheft.api.result import Result
from coheft.api.tracks import PoseTrack, RobotResult, Track
from coheft.app.results.report import Report
from coheft.errors import CoheftError, file_errors
from coheft.wire.data.replace import replace_files
from coheft.wire.scenario.schema import Scenario

_SUFFIX = ".npz"
_TEXTS = ("scenario", "report")
_TRACKS = ("mass", "com", "inertia")


def save_result(result: Result, path: Path) -> Path:
    """See ``Result.save``."""
    if path.suffix != _SUFFIX:
        raise CoheftError(f"{path}: expected a file that ends with {_SUFFIX}")
    arrays: dict[str, Any] = {
        name: np.frombuffer(msgspec.json.encode(getattr(result, name)), dtype=np.uint8) for name in _TEXTS
    }
    for name, robot in result.robots.items():
        arrays |= {f"{name}/{field.name}": getattr(robot, field.name) for field in fields(robot)}
        del arrays[f"{name}/poses"]
        parts = {each: arrays.pop(f"{name}/{each}") for each in _TRACKS}
        parts |= {f"poses/{other}": pose for other, pose in robot.poses.items()}
        for each, track in parts.items():
            arrays |= {f"{name}/{each}/{field.name}": getattr(track, field.name) for field in fields(track)}
    with file_errors(CoheftError, f"{path}: cannot be written"):
        replace_files({path: lambda file: np.savez_compressed(file, **arrays)})
    return path


def load(path: str | Path) -> Result:
    """Read a result that ``Result.save`` has written.

    Raises:
        CoheftError: The file cannot be read, or contains something else.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {key: file[key] for key in file.files}
        scenario = msgspec.json.decode(arrays["scenario"].tobytes(), type=Scenario)
        report = msgspec.json.decode(arrays["report"].tobytes(), type=Report)
        return Result(scenario, {name: _robot(arrays, name) for name in report.robots}, report)
    except OSError as error:
        raise CoheftError(f"{path}: cannot be read: {error.strerror or error}") from error
    except KeyError as error:
        raise CoheftError(
            f"{path}: expected a result that Result.save has written; found no {error}. Measurements, as of "
            f"'coheft run --save-data', go to coheft.identify"
        ) from error
    except (ValueError, TypeError, EOFError, zipfile.BadZipFile, msgspec.MsgspecError) as error:
        raise CoheftError(
            f"{path}: expected a result that Result.save of this release has written; found something else: {error}"
        ) from error


def _robot(arrays: Mapping[str, Any], name: str) -> RobotResult:
    begin = f"{name}/poses/"
    neighbours = dict.fromkeys(key[len(begin) :].split("/")[0] for key in arrays if key.startswith(begin))
    values: dict[str, Any] = {each: Track(*_parts(arrays, f"{name}/{each}", Track)) for each in _TRACKS}
    values["poses"] = {other: PoseTrack(*_parts(arrays, f"{begin}{other}", PoseTrack)) for other in neighbours}
    values |= {each.name: arrays[f"{name}/{each.name}"] for each in fields(RobotResult) if each.name not in values}
    return RobotResult(**values)


def _parts(arrays: Mapping[str, Any], key: str, kind: type[Track] | type[PoseTrack]) -> list[Any]:
    return [arrays[f"{key}/{field.name}"] for field in fields(kind)]
