"""What a robot's fits take for granted."""

from __future__ import annotations

import msgspec
import pytest

from coheft.agents.efficient.settings import fit_settings
from coheft.estimation.tolerance import SensorTolerance
from coheft.wire.config import agent_config
from coheft.wire.scenario.file import load_scenario


@pytest.mark.parametrize("key", SensorTolerance.__struct_fields__)
def test_every_error_that_is_told_is_an_unknown_with_a_prior(key: str) -> None:
    config = agent_config(load_scenario("ring3"), "r1", ("r2",))
    settings = fit_settings(
        msgspec.structs.replace(config, tolerance=SensorTolerance(**{key: 0.01})), ["r1", "r2", "r3"]
    )
    offsets = settings.force_offset, settings.torque_offset, settings.gyro_offset
    if key == "velocity_offset":  # means of twists are removed, so it makes no difference
        assert settings.errors.count == 0
    elif settings.errors.count == 0:
        assert sorted(offsets) == [0.0, 0.0, 0.01]
    else:
        assert not any(offsets)
        assert settings.errors.count in (1, 3)
        size = 0.01 * (0.0174533 if "mounting" in key else 2.0**0.5 if key == "clock" else 1.0)
        assert settings.errors.deviations[0] == pytest.approx(size, rel=1e-4)
