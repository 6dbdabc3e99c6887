"""What robots say of their sensors, against what is true of them in the simulation."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from coheft.app.run.inprocess import run_in_process
from coheft.estimation.geometry.spatial import rotation_log
from coheft.estimation.tolerance import INDUSTRIAL, SENSORS
from coheft.physics_server.sensor_errors import SensorErrors
from coheft.wire.messages.structs import SensorErrorEstimate
from coheft.wire.scenario.file import load_scenario

TOLD = msgspec.structs.replace(
    INDUSTRIAL,
    force_gain=0.005,
    torque_cross_talk=0.003,
    velocity_place=0.005,
    acceleration_place=0.005,
    grasp_compliance=2e-5,
)


def true_value(errors: SensorErrors, robot: int, found: SensorErrorEstimate, anchor: int) -> float:
    """To first order, in the unit of the key."""
    late = errors.delays[robot]
    if found.key == "clock":
        return float(late[0] - errors.delays[anchor, 0])
    if found.key == "wrench_delay":
        return float(late[1] - late[0])
    if found.key == "grasp_compliance":
        return float(errors.compliances[robot])
    sensor, _, what = found.key.partition("_")
    number, axis = SENSORS.index(sensor), "xyz".find(found.axis[:1])
    if what == "offset":
        return float(errors.offsets[robot, 3 * number + axis])
    if what == "place":
        places = errors.velocity_places if sensor == "velocity" else errors.acceleration_places
        return float(places[robot, axis])
    matrix = errors.matrices[robot, number]
    if what == "mounting_deg":
        left, _, right = np.linalg.svd(matrix)
        return float(np.degrees(rotation_log(left @ right)[axis]))
    if what == "cross_talk":
        other = "xyz".find(found.axis[1])
        return float(matrix[axis, other] + matrix[other, axis]) / 2.0
    return float(matrix[axis, axis]) - 1.0


@pytest.mark.slow
def test_found_errors_are_true_within_what_is_said() -> None:
    shipped = load_scenario("real3")
    sensors = msgspec.structs.replace(shipped.sensors, tolerance=TOLD)
    scenario = msgspec.structs.replace(shipped, duration=19.0, sensors=sensors)
    last = {}
    for record in run_in_process(scenario):
        last.update(record.estimates or {})
    errors, squares, is_better = SensorErrors.drawn(scenario, 3), [], []
    for robot, name in enumerate(sorted(last)):
        found = last[name].sensor_errors
        kinds = {each.key for each in found}
        assert {"acceleration_offset", "gyro_mounting_deg", "force_scale", "clock", "grasp_compliance"} <= kinds
        for each in found:
            if each.key in ("force_gain", "force_scale"):  # what both have in common is neither's alone
                continue
            error = each.value - true_value(errors, robot, each, anchor=0)
            assert abs(error) < 5.0 * each.std + 1e-2 * each.told, (name, each, error)
            assert each.std < 1.05 * each.told * (2.0**0.5 if each.key == "clock" else 1.0)
            if each.std > 1e-6 * each.told:
                squares.append((error / each.std) ** 2)
                is_better.append(each.std < 0.5 * each.told)
    assert 0.5 < np.mean(squares) < 1.6
    assert np.mean(is_better) > 0.3
