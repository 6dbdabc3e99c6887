"""Files that former releases wrote."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.schedule import read_schedule
from coheft.wire.scenario.former import as_now

SENSORS = {"rate": 100, "offset": {"gyro": 0.0, "acceleration": 0.3, "force": 3.0}}


def test_largest_offsets_become_standard_deviations() -> None:
    assert as_now({"sensors": SENSORS})["sensors"] == {
        "rate": 100,
        "errors": {
            "gyro_offset": 0.0,
            "acceleration_offset": pytest.approx(0.3 / 3.0**0.5),
            "force_offset": pytest.approx(3.0 / 3.0**0.5),
        },
    }


def test_settings_that_are_not_needed_are_left_out_and_those_that_robots_were_told_stay() -> None:
    former = {"efficient": {"start_rotation_deg": 1.0, "refit_share": 0.05, "offsets": True, "memory": 2.0}}
    now = as_now(former)
    assert now["efficient"] == {"memory": 2.0}
    assert now["sensors"]["tolerance"] == {"force_offset": 1.2, "torque_offset": 0.06}


def test_what_is_of_this_release_stays_as_it_is() -> None:
    scenario = msgspec.to_builtins(draw_schedule(3).scenario)
    assert as_now(scenario) == scenario


def test_a_schedule_of_a_former_release_is_read(tmp_path: Path) -> None:
    schedule = draw_schedule(3, is_exact=True)
    table = msgspec.to_builtins(schedule)
    del table["scenario"]["sensors"]["errors"]
    table["scenario"]["sensors"]["offset"] = dict.fromkeys(("gyro", "velocity", "acceleration", "force", "torque"), 0.0)
    table["scenario"]["efficient"] |= {"start_rotation_deg": 1.0, "start_translation_mm": 20.0, "offsets": False}
    path = tmp_path / "former.json"
    path.write_bytes(msgspec.json.encode(table))
    read = read_schedule(path)
    assert read.faults == schedule.faults
    assert read.scenario.sensor_errors == schedule.scenario.sensor_errors
