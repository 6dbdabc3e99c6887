"""Whether recorded angular velocities are the rates of the recorded poses; if not, whether a convention is why."""

from collections.abc import Sequence

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.signals import Signals
from coheft.estimation.geometry.body_motion import BODY_W
from coheft.estimation.geometry.spatial import Array

_SLOWEST = 0.02
"""Root mean square below which angular velocities may be nothing but noise [rad/s]."""
_MISFIT, _EXPLAINED = 0.3, 0.15
"""Share of the angular velocities that poses may not explain, and that another convention may leave."""


def check_rates(names: Sequence[str], given: Signals, by_poses: Signals) -> None:
    """Check that angular velocities are those of the poses: in rad/s, about the axes of the grasp frame.

    Nothing is refused unless a factor, or the axes of the home frame, explain them. Both ``given`` signals and those
    derived ``by_poses`` are at the same times; they are the same if no twists were recorded.
    """
    assert by_poses.rotation is not None
    home = (by_poses.rotation @ by_poses.motion[..., BODY_W][..., None])[..., 0]
    pairs = zip(given.motion[..., BODY_W], by_poses.motion[..., BODY_W], home, strict=True)
    found = {name: _fault(*each) for name, each in zip(names, pairs, strict=True)}
    wrong = {name: fault for name, fault in found.items() if fault}
    if wrong:
        raise RecordingError(f"'twist' of {', '.join(wrong)}: {next(iter(wrong.values()))}")


def _fault(given: Array, expected: Array, in_home: Array) -> str:
    """Say what is wrong with angular velocities (n, 3), in words; empty if nothing is, or nothing is known of it."""
    size = float(np.linalg.norm(expected))
    if size < _SLOWEST * np.sqrt(len(expected)) or np.linalg.norm(given - expected) < _MISFIT * size:
        return ""
    factor = float(np.sum(given * expected)) / size**2
    if np.linalg.norm(given - factor * expected) < _EXPLAINED * np.linalg.norm(given):
        if factor < 0.0:
            return (
                "angular velocities have the opposite sign of those of the poses: change it; or, if it is right, the "
                "poses are those of the home frame in the grasp frame: invert them"
            )
        return (
            f"angular velocities are {factor:.4g} times those of the poses: give angular velocities in rad/s, and "
            f"times in seconds"
        )
    if np.linalg.norm(given - in_home) < _EXPLAINED * size:
        return (
            "angular velocities are those of the poses in the axes of the home frame: give twists in the axes of "
            "the grasp frame"
        )
    return ""
