"""Names that estimators had in former releases: read wherever one may stand, written nowhere.

Structs that name an estimator call ``keep_present`` when they are made, so that no other code meets a former name.
"""

from __future__ import annotations

from typing import Any

import msgspec

from coheft.errors import ScenarioError

PRESENT = {"seed": "fan2017"}
"""Estimators' present names, by the former ones."""
SECTIONS = {"seed_method": "fan2017"}
"""The same of sections of a scenario."""


def present(estimator: str) -> str:
    """The present name of an estimator."""
    return PRESENT.get(estimator, estimator)


def keep_present(struct: msgspec.Struct) -> None:
    """Let a new struct's ``estimator`` be a present name; for ``__post_init__``."""
    found: str = struct.estimator  # type: ignore[attr-defined]
    if found in PRESENT:
        msgspec.structs.force_setattr(struct, "estimator", PRESENT[found])


def rename_sections(table: dict[str, Any], origin: str) -> None:
    """Give sections of a scenario their present names.

    Args:
        table: A scenario, as nested dictionaries and lists; it is changed.
        origin: Names it in errors.

    Raises:
        ScenarioError: A key is there under both names.
    """
    for former, now in SECTIONS.items():
        if former not in table:
            continue
        section, other = table.pop(former), table.get(now, {})
        if not (isinstance(section, dict) and isinstance(other, dict)):
            table[now] = section  # no section: what reads it next says so
            continue
        for key in section.keys() & other.keys():
            raise ScenarioError(
                f"{origin}: key '{former}.{key}': found it beside '{now}.{key}', which is the same key by its present "
                f"name: leave out the former one"
            )
        table[now] = other | section
