"""Sentences about changes of the load: which robots noticed them, and when all had recovered."""

from collections.abc import Collection, Iterator, Sequence
from itertools import zip_longest

from coheft.app.names import few
from coheft.app.results.report import LoadChangeReport
from coheft.wire.messages.structs import Validity

_AS_ONE = 0.5
"""Longest time from a change to the notice of the next one for which both were noticed as one [s]."""
_MOST_NAMED = 4


def load_change_sentences(changes: Sequence[LoadChangeReport]) -> list[str]:
    """Return the sentences about each change."""
    return [_about(change, after) for change, after in zip_longest(changes, changes[1:])]


def _about(change: LoadChangeReport, after: LoadChangeReport | None) -> str:
    before = next((robot.mass.truth for robot in change.before_change.values()), None)
    start = f"from {before:.2f} kg " if before is not None else ""
    leak = f", leaking {change.leak_kg_s:g} kg/s" if change.leak_kg_s > 0.0 else ""
    recovered = "Not all recovered" if after is None else "The load changed again before all recovered"
    if change.recovered_at_s is not None:
        recovered = f"All recovered after {change.recovered_at_s - change.at_s:.1f} s"
    return (
        f"At {change.at_s:g} s the payload changed {start}to {change.truth.mass:.2f} kg{leak}. "
        f"{_noticed(change, after)}. {recovered}."
    )


def _noticed(change: LoadChangeReport, after: LoadChangeReport | None) -> str:
    """Describe which robots noticed a change, and why others did not."""
    if change.detected_at_s is not None:
        return f"The last robot noticed after {change.detected_at_s - change.at_s:.1f} s"
    robots = change.before_change
    if all(robot.mass.estimate is None for robot in robots.values()):
        return "No robot knew the load yet, so there was nothing to notice"
    own = {name: at - change.at_s for name, at in change.noticed_at_s.items() if name in robots}
    others = [name for name in robots if name not in own]
    is_soon = {name: at - change.at_s <= _AS_ONE for name, at in (after.noticed_at_s if after else {}).items()}
    stale = [name for name in others if robots[name].status is Validity.STALE]
    with_next = [name for name in others if is_soon.get(name) and name not in stale]
    not_at_all = [name for name in others if name not in (*stale, *with_next)]

    def clauses() -> Iterator[str]:
        if own:
            yield f"{_who(list(own), robots)} noticed after {max(own.values()):.1f} s"
        if with_next and after is not None:
            yield f"{_who(with_next, robots)} noticed this and the change at {after.at_s:g} s as one"
        if stale:
            was_were = "was" if len(stale) == 1 else "were"
            yield f"{_who(stale, robots)} {was_were} still stale, and noticed no further change"
        if not_at_all:
            is_all = len(not_at_all) == len(robots)
            yield "No robot noticed" if is_all else f"{_who(not_at_all, robots)} did not notice"

    return "; ".join(clauses())


def _who(names: Sequence[str], robots: Collection[str]) -> str:
    return "All robots" if len(names) == len(robots) else few(names, _MOST_NAMED)
