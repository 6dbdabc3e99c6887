"""A judge of recordings: units of one robot's moments, and points about which moments are given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from tests.estimation.batch_team import held_recording
from tests.estimation.recorded_faults import about_home, to_wrench, with_fault
from tests.estimation.test_batch_assumed import tabled_deviations
from tests.estimation.test_batch_judge import SEED, judged


@pytest.mark.parametrize(
    ("seed", "robot", "factor", "unit"),
    [
        *((1, "r1", 1000.0, "N·mm"), (2, "r3", 1000.0, "N·mm"), (2, "r1", 100.0, "N·cm")),
        *((1, "r3", 10.1972, "kgf·cm"), (2, "r1", 10.1972, "kgf·cm")),
    ],
)
def test_the_unit_of_one_robots_moments_is_named(seed: int, robot: str, factor: float, unit: str) -> None:
    scaled = to_wrench(lambda wrench: wrench * [1.0, 1.0, 1.0, factor, factor, factor])
    _, verdict = judged(with_fault(held_recording(seed), scaled, robot))
    assert (verdict.cause, verdict.robot) == ("moment scale", robot)
    assert verdict.words.split(". With it")[0].endswith(f"times what they should be: {unit}")
    assert verdict.value[0] == pytest.approx(factor, rel=0.05)


@pytest.mark.parametrize(("seed", "gone"), [(0, "r3"), (5, "r2")])
def test_a_robot_that_was_not_recorded_may_carry_the_load(seed: int, gone: str) -> None:
    recording = held_recording(seed)
    rest = {name: robot for name, robot in recording.robots.items() if name != gone}
    _, verdict = judged(replace(recording, robots=rest, truth=None))
    assert verdict.cause == "unknown"
    assert "or does something else that was not recorded also carry the load?" in verdict.words


def test_moments_alone_that_fit_no_load_are_not_carried_by_others() -> None:
    uneven = to_wrench(lambda wrench: wrench * np.where(np.arange(6) < 3, 1.0, 1.0 + 0.5 * np.sin(wrench)))
    _, verdict = judged(with_fault(held_recording(SEED), uneven, "r1"))
    assert verdict.cause == "unknown"
    assert "carry the load" not in verdict.words


@pytest.mark.parametrize(("robots", "is_turned"), [(("r2",), True), (("r1", "r2", "r3"), False)])
def test_moments_about_the_origin_of_the_home_frame_are_named_and_mended(
    robots: tuple[str, ...], is_turned: bool
) -> None:
    recording = with_fault(held_recording(SEED), about_home(is_turned=is_turned), *robots)
    _, verdict = judged(recording)
    assert (verdict.cause, verdict.robot) == ("home moments", robots[0] if len(robots) == 1 else None)
    assert "are about the origin of the home frame, not of the grasp frame" in verdict.words
    assert ("the whole wrench is in its axes" in verdict.words) == is_turned
    found = identify(recording, Options(assume="home moments"))
    assert found.doubts == ()
    assert tabled_deviations(recording, found).max() < 5.0


@pytest.mark.parametrize(
    ("point", "seed", "robot"), [((0.3, -0.2, 0.4), 0, "r2"), ((0.5, 0.5, 0.0), 1, "r1"), ((-0.4, 0.1, 0.2), 1, "r2")]
)
def test_a_factor_that_is_no_unit_and_leaves_much_is_no_scale(
    point: tuple[float, float, float], seed: int, robot: str
) -> None:
    _, verdict = judged(with_fault(held_recording(seed), about_home(point), robot))
    assert verdict.is_refuted
    assert verdict.cause == "unknown", verdict.words


@pytest.mark.parametrize(
    ("turn_deg", "seed", "count"),
    [
        *(((0.0, 0.0, 45.0), 12, 3), ((0.0, 0.0, 135.0), 4, 3), ((66.0, 11.0, -50.0), 2, 2)),
        *(((-35.0, -38.0, 145.0), 11, 3), ((-69.0, -1.0, -95.0), 20, 2)),
    ],
)
def test_a_rotation_of_all_sensors_is_found(turn_deg: tuple[float, float, float], seed: int, count: int) -> None:
    turn = Rotation.from_rotvec(turn_deg, degrees=True)
    mounted = to_wrench(lambda wrench: np.hstack([turn.apply(wrench[:, :3]), turn.apply(wrench[:, 3:])]))
    recording = held_recording(seed, count)
    _, verdict = judged(with_fault(recording, mounted, *recording.names))
    assert (verdict.cause, verdict.robot) == ("sensor turned", None)
    assert f"by {np.linalg.norm(turn_deg):.3g} degrees" in verdict.words
