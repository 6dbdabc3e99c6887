"""Maximum likelihood from recordings of sensors: what it claims, and what not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coheft.app.identify.choices import Options
from coheft.app.identify.methods import identify
from coheft.errors import RecordingError
from coheft.estimation.batch.identify import identify_sensors
from coheft.estimation.batch.signals import total_wrench
from coheft.estimation.measurement import SensorNoise
from coheft.estimation.rigid_body.consistency import nearest_possible
from coheft.estimation.rigid_body.derivatives import central_derivative
from coheft.estimation.rigid_body.unobservable import middle_and_size
from tests.estimation.batch_team import LOAD, exact_signals, grasps, sensors_recording, sliding

NOISE = SensorNoise()


@pytest.mark.parametrize("seed", range(3))
def test_nothing_is_claimed_that_hangs_on_unobservable_poses(seed: int) -> None:
    """A load that does not turn does not show where others hold it, and so not which way they lift."""
    rng = np.random.default_rng(seed)
    team = grasps(rng)
    signals = exact_signals(rng, team, motion=sliding())
    third = total_wrench(signals.wrench, team) / 3.0
    signals = replace(signals, wrench=np.array([third @ np.linalg.inv(pose.adjoint()).T for pose in team]))
    found = identify_sensors(sensors_recording(rng, signals, NOISE))
    payload = found.payload
    assert payload.is_seen("mass") == (payload.std[0] <= 0.3 * payload.inertia.mass)
    assert not payload.is_seen("com")
    assert not payload.is_seen("inertia")


def test_of_a_load_at_rest_without_noise_only_the_mass_may_be_seen() -> None:
    rng = np.random.default_rng(0)
    rest = np.tile(np.repeat([0.0, 9.81, 0.0], [8, 1, 3]), (1000, 1))
    still = sensors_recording(rng, exact_signals(rng, grasps(rng), motion=rest), NOISE.scaled(1e-300))
    found = identify_sensors(replace(still, noise=NOISE))
    assert all(len(found.team.relative(0, k).unobservable) >= 3 for k in (1, 2))
    assert not found.payload.is_seen("com")
    assert not found.payload.is_seen("inertia")


def test_robots_that_hold_different_loads_are_suspected() -> None:
    rng = np.random.default_rng(1)
    team = grasps(rng)
    several = [sensors_recording(rng, exact_signals(rng, team), NOISE) for _ in team]
    robots = {name: own.robots[name] for name, own in zip(several[0].names, several, strict=True)}
    broken_off = "The fit of the poses did not converge"
    assert not any(broken_off in doubt for doubt in identify_sensors(several[0]).doubts)
    assert any(broken_off in doubt for doubt in identify_sensors(replace(several[0], robots=robots)).doubts)


def test_what_is_not_seen_need_not_settle() -> None:
    rng = np.random.default_rng(2)
    spinning = np.tile([0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (2000, 1))
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng), motion=spinning), NOISE)
    found = identify(recording, Options(method="instruments"))
    assert found.team.relative(0, 1).unobservable
    assert not any("did not converge" in doubt for doubt in found.doubts)


@pytest.mark.parametrize(
    ("factor", "advice"), [(0.3, "are the sensors worse than"), (4.0, "deviations of single samp")]
)
def test_noise_that_is_not_that_of_the_samples_is_suspected(factor: float, advice: str) -> None:
    rng = np.random.default_rng(3)
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng)), NOISE)
    assert not identify_sensors(recording).doubts
    (doubt,) = identify_sensors(replace(recording, noise=NOISE.scaled(factor))).doubts
    assert advice in doubt


def test_a_robot_that_is_there_twice_is_refused() -> None:
    rng = np.random.default_rng(3)
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng)), NOISE)
    twice = replace(recording, robots={**recording.robots, "r2": recording.robots["r1"]})
    with pytest.raises(RecordingError, match="r1 and r2 recorded exactly the same"):
        identify(twice, Options(method="likelihood"))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_what_cannot_be_computed_with_is_told() -> None:
    rng = np.random.default_rng(0)
    recording = sensors_recording(rng, exact_signals(rng, grasps(rng)), NOISE)
    with pytest.raises(RecordingError, match=r"--method likelihood cannot compute with these numbers \("):
        identify(replace(recording, noise=NOISE.scaled(1e-170)), Options(method="likelihood"))
    huge = recording.changed("wrench", lambda wrench: 1e200 * wrench, "r2")
    with pytest.raises(RecordingError, match=r"--method instruments cannot compute with these numbers \("):
        identify(huge, Options(method="instruments"))


def test_impossible_bodies_are_made_possible_in_the_metric_of_all_errors() -> None:
    """Poses that are a little off do more than the noise of seconds of samples."""
    impossible = replace(LOAD, tensor=np.diag([1.0, 1.0, 2.5]))
    rng = np.random.default_rng(0)
    signals = exact_signals(rng, grasps(rng), load=impossible)
    found = identify_sensors(sensors_recording(rng, signals, NOISE))
    payload = found.payload
    assert not payload.was_possible
    to_central = central_derivative(payload.inertia)
    information = to_central.T @ np.linalg.inv(payload.covariance) @ to_central
    expected = nearest_possible(payload.measured.barycentric(), information, middle_and_size(found.team.poses)[1])
    np.testing.assert_allclose(payload.inertia.barycentric(), expected, atol=1e-6)
