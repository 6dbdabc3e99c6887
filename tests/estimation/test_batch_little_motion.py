"""Loads that turn about one axis, or not at all: what is not observable is said, and no wrong number is given."""

from __future__ import annotations

import pytest

from coheft.app.identify.methods import identify
from coheft.app.identify.report import make_report
from coheft.estimation.batch.hand_eye import fit_hand_eye
from coheft.estimation.batch.pairs import grasps_from_twists
from coheft.estimation.batch.plausibility import check_conventions, plausible_signals
from coheft.estimation.batch.signals import CUTOFF, signals_of
from coheft.estimation.batch.wrist_poses import WristPoses
from tests.estimation.batch_team import held_recording

NONE, ABOUT_X, ABOUT_Y, ABOUT_Z = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


@pytest.mark.parametrize(("turns", "count", "seed"), [(NONE, 2, 0), (NONE, 3, 2), (ABOUT_Z, 2, 2), (ABOUT_Z, 3, 0)])
def test_where_robots_hold_is_not_seen_so_neither_is_the_load(
    turns: tuple[float, float, float], count: int, seed: int
) -> None:
    recording = held_recording(seed, count, turns=turns)
    found = identify(recording)
    report = make_report("x", recording, found)
    assert found.doubts == ()
    assert found.verdict is None
    assert (report.payload.com_m, report.payload.principal) == (None, None)
    assert any(one.startswith("centre of mass") for one in report.not_observable)
    assert report.payload.mass_kg == pytest.approx(6.2, abs=5.0 * (report.payload.mass_std_kg or 0.0))


@pytest.mark.parametrize(("turns", "count", "seed"), [(ABOUT_Z, 2, 1), (ABOUT_Z, 3, 2)])
def test_where_the_fit_wanders_poses_do_not_differ(turns: tuple[float, float, float], count: int, seed: int) -> None:
    """All robots move as on one axis, so that even rotations about it are not observable."""
    found = identify(held_recording(seed, count, turns=turns, shifts=0.0))
    assert not found.team.is_observable
    assert found.doubts == ()


@pytest.mark.parametrize(("count", "seed"), [(2, 2), (3, 2)])
def test_noise_of_orientations_shows_no_grasp(count: int, seed: int) -> None:
    recording = held_recording(seed, count, turns=ABOUT_X)
    start, _ = grasps_from_twists(plausible_signals(recording, CUTOFF), with_instruments=True)
    wrists = WristPoses.of(recording.stacked("pose"), recording.rate, at_home=False)
    assert not fit_hand_eye(wrists.averaged(25.0), start.poses).team.is_observable


def test_one_axis_leaves_open_how_grasps_are_rotated() -> None:
    """Their velocities tell, so that positions are not taken for those with other axes."""
    recording = held_recording(0, 2, turns=ABOUT_Y)
    check_conventions(recording, CUTOFF, signals_of(recording, CUTOFF))
