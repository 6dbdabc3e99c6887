"""Evaluation of how changes of the load were noticed."""

from collections.abc import Mapping, Sequence

import msgspec

from coheft.wire.messages.structs import LoadChangeNotice


class Detection(msgspec.Struct, frozen=True):
    """Statistics of noticing load changes.

    Attributes:
        delay_s: Mean time until the last robot had noticed, over runs in which all did [s]; None if there are none.
        delay_max_s: The longest of these times [s].
        missed: Number of runs in which at least one robot did not notice.
        false_alarms: Notices without a change; those of several robots that agree count once.
        false_alarms_per_hour: False alarms per simulated hour; None if no time was simulated.
        hours: Simulated time [h].
    """

    delay_s: float | None
    delay_max_s: float | None
    missed: int
    false_alarms: int
    false_alarms_per_hour: float | None
    hours: float


def judge_detection(
    runs: Sequence[Mapping[str, Sequence[LoadChangeNotice]]], change: float | None, duration: float
) -> Detection:
    """Compare the robots' notices, by name, of each run with the true change [s]; all last for ``duration`` [s]."""
    delays: list[float] = []
    missed = alarms = 0
    for robots in runs:
        noticed = [_first_after(notices, change) for notices in robots.values()]
        alarms += len({when for notices in robots.values() for when in _false_alarms(notices, change)})
        known = [notice.noticed_at for notice in noticed if notice is not None]
        if change is not None and len(known) == len(noticed):
            delays.append(round(max(known) - change, 9))
        elif change is not None:
            missed += 1
    hours = len(runs) * duration / 3600.0
    return Detection(
        delay_s=sum(delays) / len(delays) if delays else None,
        delay_max_s=max(delays, default=None),
        missed=missed,
        false_alarms=alarms,
        false_alarms_per_hour=alarms / hours if hours > 0.0 else None,
        hours=hours,
    )


def _first_after(notices: Sequence[LoadChangeNotice], change: float | None) -> LoadChangeNotice | None:
    return next((notice for notice in notices if change is not None and notice.noticed_at > change), None)


def _false_alarms(notices: Sequence[LoadChangeNotice], change: float | None) -> list[float]:
    """Return the times of claimed changes that did not happen.

    After the change was noticed, its time may be corrected; only claims of changes after the first notice are false.
    """
    first = _first_after(notices, change)
    return [
        round(notice.changed_at, 9)
        for notice in notices
        if first is None or notice.noticed_at < first.noticed_at or notice.changed_at > first.noticed_at
    ]
