"""Causes that are assumed are taken out of the recording."""

from __future__ import annotations

import numpy as np
import pytest

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.identification import Identification
from coheft.estimation.batch.judge.verdict import Cause
from coheft.estimation.batch.plausibility import inverse_poses
from coheft.estimation.batch.recording import Recording
from coheft.estimation.geometry.spatial import Array
from tests.estimation.batch_team import held_recording
from tests.estimation.recorded_faults import (
    Fault,
    drifting,
    exchanged,
    half_in_home_axes,
    home_turned,
    in_home_axes,
    late,
    lever,
    one_axis,
    to_wrench,
    turned,
    with_fault,
)
from tests.estimation.test_batch_judge import SEED, deviations, slipped


def late_with_other_signs(pose: Array) -> Array:
    """Late by 25 ms, with quaternions that change their signs every half second."""
    moved = np.concatenate([np.repeat(pose[:1], 3, axis=0), 0.5 * (pose[1:-2] + pose[:-3])])
    moved[:, 3:] /= np.linalg.norm(moved[:, 3:], axis=1, keepdims=True)
    moved[np.arange(len(moved)) // 50 % 2 == 0, 3:] *= -1.0
    return moved


@pytest.mark.parametrize(
    ("fault", "robots", "cause"),
    [
        (to_wrench(lambda wrench: wrench - wrench[:20].mean(axis=0)), ("r1", "r2", "r3"), Cause.OFFSET),
        (to_wrench(drifting), (), Cause.DRIFT),
        (to_wrench(lever), ("r1", "r2", "r3"), Cause.LEVER),
        (to_wrench(lambda wrench: -1.1 * wrench), (), Cause.SCALE),
        (to_wrench(lambda wrench: wrench * [1.1, 1.1, 1.1, 1.0, 1.0, 1.0]), (), Cause.FORCE_SCALE),
        (to_wrench(lambda wrench: wrench * [1, 1, 1, 0.102, 0.102, 0.102]), ("r1", "r2", "r3"), Cause.MOMENT_SCALE),
        (in_home_axes, ("r1", "r2", "r3"), Cause.BASE_AXES),
        (half_in_home_axes(1), (), Cause.BASE_AXES),
        (one_axis(2, -1.0), (), Cause.AXIS_SCALE),
        (to_wrench(exchanged), (), Cause.TURNED),
        (to_wrench(late), (), Cause.CLOCK),
        (lambda pose, wrench: (late(pose), late(wrench)), (), Cause.CLOCK),
        (lambda pose, wrench: (late_with_other_signs(pose), wrench), (), Cause.CLOCK),
        (home_turned(np.array([0.05, 0.0, 0.0])), (), Cause.NOT_LEVEL),
        (lambda pose, wrench: (inverse_poses(pose), wrench), ("r1", "r2", "r3"), Cause.INVERSE),
    ],
)
def test_what_is_assumed_is_taken_out(fault: Fault, robots: tuple[str, ...], cause: Cause) -> None:
    recording = with_fault(held_recording(SEED), fault, *robots)
    found = identify(recording, Options(assume=cause))
    assert found.doubts == ()
    assert found.remarks[0].startswith(f"Corrected, as assumed ({cause}): ")
    assert deviations(recording, found).max() < 5.0
    assert tabled_deviations(recording, found).max() < 5.0


def tabled_deviations(recording: Recording, found: Identification) -> Array:
    """Errors in the standard deviations of the table, shape (10,)."""
    assert recording.truth is not None
    truth = recording.truth.loads[0][1].central()
    result: Array = np.abs(found.payload.inertia.central() - truth) / found.payload.std
    return result


def test_axes_are_right_or_wrong_without_a_standard_deviation() -> None:
    recording = held_recording(SEED)
    found = identify(with_fault(recording, in_home_axes, *recording.names), Options(assume="base axes"))
    plain = identify(recording)
    for one, other in zip(found.hidden, plain.hidden, strict=True):
        assert one.std == pytest.approx(other.std, rel=0.01)


def test_what_cannot_be_assumed_is_refused() -> None:
    recording = held_recording(SEED)
    with pytest.raises(RecordingError, match="nothing is wrong with the recording"):
        identify(recording, Options(assume="offset"))
    wrong = with_fault(recording, to_wrench(turned))
    with pytest.raises(RecordingError, match=r"does not explain the recording\. .* is turned against the grasp frame"):
        identify(wrong, Options(assume="lever"))
    with pytest.raises(RecordingError, match="it can be any of: offset, "):
        identify(wrong, Options(assume="weather"))
    slip = with_fault(recording, slipped(0.0, 0.005))
    with pytest.raises(RecordingError, match="nothing says what sensors would have read without 'slip'"):
        identify(slip, Options(assume="slip"))
