"""Names and keys of earlier releases: they are still read, but no longer written.

Structs with the name of an estimator call ``keep_present`` on creation, so that no other code handles earlier names.
"""

from functools import lru_cache
from typing import Any

import msgspec

from coheft.errors import ScenarioError

PRESENT = {"seed": "fan2017"}
"""Present names of estimators, by earlier name."""
SECTIONS = {"seed_method": "fan2017"}
"""Present names of sections of a scenario, by earlier name."""
GONE = {
    "efficient.start_rotation_deg": "the estimator no longer uses sums with rough poses",
    "efficient.start_translation_mm": "the estimator no longer uses sums with rough poses",
    "efficient.refit_share": "the fit is repeated whenever there are 15 % more measurements",
}
"""Keys of a scenario that are no longer needed, with the reasons."""
_DEVIATION = 3.0**-0.5
"""Standard deviation of an error that is uniform up to a largest one, relative to it."""


@lru_cache(maxsize=64)
def present(estimator: str) -> str:
    """Return the present name of an estimator, or of several with commas between."""
    return ",".join(PRESENT.get(name, name) for name in map(str.strip, estimator.split(",")))


def keep_present(struct: msgspec.Struct) -> None:
    """Replace an earlier name in a new struct's field ``estimator``; for ``__post_init__``."""
    found: str = struct.estimator  # type: ignore[attr-defined]
    if (name := present(found)) != found:
        msgspec.structs.force_setattr(struct, "estimator", name)


def rename_sections(table: dict[str, Any], origin: str) -> None:
    """Rename sections of a scenario, in place, that have earlier names.

    A key under both names is a ``ScenarioError``, in which ``origin`` names the scenario.
    """
    for former, now in SECTIONS.items():
        if former not in table:
            continue
        section, other = table.pop(former), table.get(now, {})
        if not (isinstance(section, dict) and isinstance(other, dict)):
            table[now] = section  # not a section, which the next check reports
            continue
        for key in section.keys() & other.keys():
            raise ScenarioError(
                f"{origin}: key '{former}.{key}': found both this key and '{now}.{key}', which is its present name: "
                f"remove '{former}.{key}'"
            )
        table[now] = other | section


def as_present(scenario: dict[str, Any], origin: str) -> dict[str, Any]:
    """Return the present form of a scenario's table, as version 345a219 wrote it into recordings and fault schedules.

    Largest constant errors (``sensors.offset``) become standard deviations of true errors, and the tolerances that
    robots assumed for them (``efficient.offsets``) become tolerances. Other sensors were exact, which robots of this
    release do not know: they allow for the errors of a good industrial arm. Errors are those of ``rename_sections``.
    """
    result = dict(scenario)
    rename_sections(result, origin)
    efficient, sensors = result.get("efficient"), result.get("sensors")
    if not (isinstance(efficient, dict) and isinstance(sensors, dict)):
        return result
    kept = {key: value for key, value in efficient.items() if f"efficient.{key}" not in GONE and key != "offsets"}
    result["efficient"] = kept
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
