"""Rules that a scenario has to meet, beyond what the types of its keys say.

A rule is a function that returns complaints about a scenario: none if it is met.
"""

import math
from collections.abc import Callable, Iterable, Iterator

import msgspec

from coheft.errors import ScenarioError
from coheft.wire.scenario.schema import Scenario

Complaint = tuple[str, str]
"""The key of a scenario that is wrong, and what was found and expected there."""
Rule = Callable[[Scenario], Iterable[Complaint]]


def check(scenario: Scenario, origin: str, *rules: Rule) -> None:
    """Raise the first complaint of some rules, in this order, as a ``ScenarioError``; ``origin`` names the source."""
    for rule in rules:
        for key, complaint in rule(scenario):
            raise ScenarioError(f"{origin}: key '{key}': {complaint}")


def exactly_one(section: msgspec.Struct, keys: tuple[str, ...], place: str) -> Iterator[Complaint]:
    """Complain unless exactly one of some keys is given."""
    given = [f"'{key}'" for key in keys if getattr(section, key) not in (None, ())]
    if len(given) != 1:
        found = f"both {' and '.join(given)}" if given else f"neither {' nor '.join(repr(key) for key in keys)}"
        yield place, f"found {found}, expected exactly one of them"


def rounded_down(value: float) -> float:
    """Round to two digits; 0 if there are none."""
    if not 0.0 < value < math.inf:
        return 0.0
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.floor(value / unit) * unit
