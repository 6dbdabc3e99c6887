"""Scenarios as version 345a219 wrote them into recordings and fault schedules."""

from typing import Any

from coheft.wire.former_names import rename_sections

_GONE = ("start_rotation_deg", "start_translation_mm", "refit_share")
"""Settings of the former default estimator that have no successor."""
_DEVIATION = 3.0**-0.5
"""Standard deviation of an error that is uniform up to a largest one, relative to it."""


def as_present(scenario: dict[str, Any], origin: str) -> dict[str, Any]:
    """Return the table of a scenario with the keys of this release.

    Largest constant errors (``sensors.offset``) become standard deviations of true errors, and the tolerances that
    robots assumed for them (``efficient.offsets``) become tolerances. Other sensors were exact, which robots of this
    release do not know: they allow for the errors of a good industrial arm.

    Raises:
        ScenarioError: A key is present under its former and its present name.
    """
    result = dict(scenario)
    rename_sections(result, origin)
    efficient, sensors = result.get("efficient"), result.get("sensors")
    if not (isinstance(efficient, dict) and isinstance(sensors, dict)):
        return result
    result["efficient"] = {key: value for key, value in efficient.items() if key not in (*_GONE, "offsets")}
    result["sensors"] = {key: value for key, value in sensors.items() if key != "offset"}
    if efficient.get("offsets"):
        result["sensors"].setdefault("tolerance", {"force_offset": 1.2, "torque_offset": 0.06})
    if isinstance(largest := sensors.get("offset"), dict):
        errors = {
            f"{sensor}_offset": _DEVIATION * value if isinstance(value, int | float) else value  # refused later
            for sensor, value in largest.items()
            if value
        }
        result["sensors"]["errors"] = errors or "none"
    return result
