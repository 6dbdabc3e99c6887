"""Names that estimators had in earlier releases: they are still read, but no longer written.

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
    """Rename sections of a scenario, in place, that have earlier names; ``origin`` names it in errors.

    Raises:
        ScenarioError: A key is present under both names.
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
