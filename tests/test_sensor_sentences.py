"""Sentences about sensors that are off."""

from __future__ import annotations

import pytest

from coheft.app.results.judge import ComReport, InertiaReport, MassReport, RobotReport
from coheft.app.terminal.sensor_sentences import sensor_sentences
from coheft.wire.messages.structs import SensorErrorEstimate


def robot(*errors: SensorErrorEstimate) -> RobotReport:
    return RobotReport(
        time_s=1.0,
        mass=MassReport(1.0),
        com=ComReport([0.0, 0.0, 0.0]),
        inertia=InertiaReport([[0.0] * 3] * 3),
        poses={},
        converged=False,
        converged_at_s=None,
        not_observable=[],
        sensor_errors=list(errors),
    )


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (("gyro_mounting_deg", "z", 1.4, 0.1, 0.5), "r3's gyro is turned by 1.4 ± 0.1° (tolerance 0.5°) about z."),
        (
            ("acceleration_offset", "x", -0.2, 0.01, 0.05),
            "r3's accelerometer reads 0.2 ± 0.01 m/s² (tolerance 0.05 m/s²) too little along x.",
        ),
        (("force_gain", "", 0.02, 0.001, 0.005), "r3's force sensor reads 2 ± 0.1 % (tolerance 0.5 %) too much."),
        (
            ("torque_cross_talk", "xy", 0.02, 0.001, 0.005),
            "r3's torque sensor reads 2 ± 0.1 % (tolerance 0.5 %) of x and y of each other.",
        ),
        (
            ("velocity_place", "y", 0.02, 0.001, 0.005),
            "r3's velocity sensor is 20 ± 1 mm (tolerance 5 mm) away along y.",
        ),
        (
            ("force_offset", "z", 1234.0, 11.0, 100.0),
            "r3's force sensor reads 1230 ± 10 N (tolerance 100 N) too much along z.",
        ),
        (("grasp_compliance", "", 6e-5, 1e-6, 2e-5), "r3's grasp yields by 0.06 ± 0.001 mm/N (tolerance 0.02 mm/N)."),
        (("clock", "", 0.003, 0.0001, 0.001), "r3's clock is 3 ± 0.1 ms (tolerance 1 ms) late."),
        (
            ("wrench_delay", "", -0.003, 0.0001, 0.001),
            "r3's force and torque sensor is 3 ± 0.1 ms (tolerance 1 ms) early.",
        ),
    ],
)
def test_an_error_is_told_in_its_own_words(error: tuple[str, str, float, float, float], words: str) -> None:
    assert sensor_sentences({"r1": robot(), "r3": robot(SensorErrorEstimate(*error))}) == [words]


def test_only_what_is_large_for_what_was_told_and_surely_found_is_told_the_largest_first() -> None:
    errors = [
        SensorErrorEstimate("force_scale", "x", 0.009, 0.001, 0.005),
        SensorErrorEstimate("force_scale", "y", 0.02, 0.003, 0.005),
        SensorErrorEstimate("force_scale", "z", 0.011, 0.001, 0.005),
    ]
    found = sensor_sentences({"r1": robot(*errors), "r2": robot(SensorErrorEstimate("clock", "", 0.01, 1e-4, 1e-3))})
    assert [sentence.partition(" is ")[0].partition(" reads ")[0] for sentence in found] == [
        "r2's clock",
        "r1's force sensor",
    ]
    assert "along z" in found[1]
