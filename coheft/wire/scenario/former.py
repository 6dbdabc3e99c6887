"""Scenarios as former releases wrote them, in files that no one writes by hand."""

from __future__ import annotations

from typing import Any

from coheft.wire.former_names import rename_sections

_NOT_NEEDED = ("start_rotation_deg", "start_translation_mm", "refit_share")
"""Keys of the default estimator before it was another one."""
_DEVIATION = 3.0**-0.5
"""Of an error that is spread evenly up to a largest one, relative to that."""


def as_now(scenario: dict[str, Any]) -> dict[str, Any]:
    """A scenario's table with the keys of this release; what is not of a former one stays as it is.

    Largest constant errors (``sensors.offset``) become standard deviations of true errors, and what robots were told of
    them (``efficient.offsets``) tolerances. Robots that were told nothing have this release's tolerances.
    """
    result = dict(scenario)
    rename_sections(result, "former scenario")
    if isinstance(efficient := scenario.get("efficient"), dict):
        kept = {key: value for key, value in efficient.items() if key not in _NOT_NEEDED}
        is_told = kept.pop("offsets", False)
        result["efficient"] = kept
        if is_told:
            sensors = dict(result.get("sensors", {}))
            sensors.setdefault("tolerance", {"force_offset": 1.2, "torque_offset": 0.06})
            result["sensors"] = sensors
    now = result.get("sensors")
    if isinstance(now, dict) and isinstance(largest := now.get("offset"), dict):
        errors = {f"{sensor}_offset": _DEVIATION * value for sensor, value in largest.items()}
        result["sensors"] = {key: value for key, value in now.items() if key != "offset"} | {"errors": errors}
    return result
