"""Reading of recordings of a cart, ``.csv`` or ``.npz``; ``docs/cart.md`` describes them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from coheft.errors import RecordingError, one_line, recording_errors
from coheft.estimation.geometry.spatial import Array
from coheft.wire.data.file import load_arrays
from coheft.wire.data.table import read_table

COLUMNS = {
    "t": ("t",),
    "pose": ("x", "y", "theta"),
    "rates": ("vx", "vy", "omega"),
    "push": ("fx", "fy", "mz"),
    "planned": ("planned_fx", "planned_fy", "planned_mz"),
}
"""Names of columns in CSV files, by the name of the array in ``.npz`` files."""
_OPTIONAL = "planned"
_LEAST_SAMPLES = 100
_SLOWEST = 0.11
"""Longest time between two samples for the filter [s]."""
_EXPECTED = ".csv with a line of names and then numbers, or .npz; docs/cart.md describes both"


@dataclass(frozen=True, eq=False)
class CartRecording:
    """Samples of a cart.

    Attributes:
        times: Times, shape (n,) [s].
        poses: ``(x, y, theta)`` of the cart's frame on the floor, shape (n, 3) [m, m, rad].
        rates: Derivatives of the poses, in the floor's axes, shape (n, 3) [m/s, m/s, rad/s].
        pushes: ``(f_x, f_y, tau)`` from a sample to the next, in the cart's axes, shape (n, 3) [N, N, N·m].
        planned: Planned pushes, shape (n, 3); None if unknown.
    """

    times: Array
    poses: Array
    rates: Array
    pushes: Array
    planned: Array | None = None


def read_cart_recording(path: Path) -> CartRecording:
    """Read a recording, and check its form; a ``RecordingError`` says where it cannot be used, and why."""
    with recording_errors(path, advice=f"; expected a {_EXPECTED}"):
        arrays = _read(path)
        _check(arrays)
    poses = arrays["pose"].copy()
    poses[:, 2] = np.unwrap(poses[:, 2])
    return CartRecording(arrays["t"], poses, arrays["rates"], arrays["push"], arrays.get(_OPTIONAL))


def _read(path: Path) -> dict[str, Array]:
    if path.is_dir():
        raise RecordingError(f"found a folder, expected a file: {_EXPECTED}")
    match path.suffix.lower():
        case ".npz":
            arrays = load_arrays(path)
            _check_names("key", list(arrays), list(COLUMNS), [_OPTIONAL])
            return {name: array.ravel() if name == "t" else array for name, array in arrays.items()}
        case ".csv":
            table = read_table(path)
            names = [column for columns in COLUMNS.values() for column in columns]
            is_planned = any(column in table.names for column in COLUMNS[_OPTIONAL])
            _check_names("column", list(table.names), names, [] if is_planned else list(COLUMNS[_OPTIONAL]))
            arrays = {name: table.numbers(columns) for name, columns in COLUMNS.items() if columns[0] in table.names}
            return {**arrays, "t": arrays["t"].ravel()}
    raise RecordingError(f"found a file that ends with '{one_line(path.suffix)}', expected a {_EXPECTED}")


def _check_names(kind: str, found: list[str], known: list[str], optional: list[str]) -> None:
    """Check that all names but optional ones are there, and no others."""
    missing = [name for name in known if name not in found and name not in optional]
    unknown = [name for name in found if name not in known]
    if missing:
        also = f"; found also {', '.join(map(one_line, unknown))}" if unknown else ""
        raise RecordingError(f"{kind} '{missing[0]}' is missing{also}; expected {', '.join(known)}")
    if unknown:
        raise RecordingError(f"{kind} '{one_line(unknown[0])}' is unknown; allowed: {', '.join(known)}")


def _check(arrays: dict[str, Array]) -> None:
    times = arrays["t"]
    if len(times) < _LEAST_SAMPLES:
        raise RecordingError(f"found {len(times)} samples, expected {_LEAST_SAMPLES} at least: record for longer")
    for name, array in arrays.items():
        width = (3,) if name != "t" else ()
        if array.shape != (len(times), *width):
            raise RecordingError(f"'{name}' has shape {array.shape}, expected {(len(times), *width)}")
        wrong = ~np.isfinite(array).reshape(len(array), -1).all(axis=1)
        if wrong.any():
            sample = int(np.flatnonzero(wrong)[0])
            raise RecordingError(
                f"'{name}' of sample {sample + 1} is {array[sample]}, expected finite numbers: leave such samples out"
            )
    steps = np.diff(times)
    back = np.flatnonzero(steps <= 0.0)
    if len(back):
        sample = int(back[0])
        raise RecordingError(
            f"times must rise, but sample {sample + 2} is at {times[sample + 1]:g} s after one at {times[sample]:g} s"
        )
    usual, longest = float(np.median(steps)), int(np.argmax(steps))
    if usual > _SLOWEST:
        raise RecordingError(
            f"found {1.0 / usual:.3g} samples per second, expected 10 at least: record faster, or if these times are "
            f"in milliseconds divide them by 1000"
        )
    if steps[longest] > max(_SLOWEST, 5.0 * usual):
        raise RecordingError(
            f"nothing was recorded from {times[longest]:g} s to {times[longest + 1]:g} s: split it into two recordings"
        )
