"""Summary of a campaign."""

from collections.abc import Sequence

import msgspec
import numpy as np

from coheft.app.faults.trial import Outcome

_LONG = 1.0
"""Time within which a robot should notice a visible error [s]."""


class KindSummary(msgspec.Struct, frozen=True):
    """Summary of all schedules with a kind of fault.

    Attributes:
        went_stale: Number of schedules in which a robot published a stale estimate.
        violations: Number of promises broken in these schedules.
        off: Number of schedules in which a robot reported wrong numbers as valid, and in which it did for more than 1
            s.
        recovered_s: Median, 95th percentile and largest time from its end until all were valid again [s], over the
            schedules in which it ended last; None if there are none.
    """

    kind: str
    injected: int
    schedules: int
    went_stale: int
    violations: int
    off: tuple[int, int]
    recovered_s: tuple[float, float, float] | None


class CampaignSummary(msgspec.Struct, frozen=True):
    """Summary of a campaign.

    Attributes:
        seeds: First and last seed.
        lost: Number of schedules in which the robots lost the payload, which ended them.
        first_valid_s: Like ``KindSummary.recovered_s``, for the time until all were valid for the first time.
        lies: Number of agents that lied, and number of them that another agent named.
        undeclared: Number of schedules in which sensor errors exceeded the known tolerances; of those in which a robot
            reported wrong numbers as valid; and of those in which it did for more than 1 s.
    """

    seeds: tuple[int, int]
    schedules: int
    simulated_h: float
    violations: int
    failed: list[int]
    lost: int
    first_valid_s: tuple[float, float, float] | None
    refused: int
    lies: tuple[int, int]
    undeclared: tuple[int, int, int]
    kinds: list[KindSummary]


def summarise(outcomes: Sequence[Outcome]) -> CampaignSummary:
    """Summarize a campaign with at least one outcome."""
    seeds = [outcome.seed for outcome in outcomes]
    kinds = sorted({kind for outcome in outcomes for kind in outcome.faults})
    return CampaignSummary(
        seeds=(min(seeds), max(seeds)),
        schedules=len(outcomes),
        simulated_h=round(sum(outcome.simulated for outcome in outcomes) / 3600.0, 3),
        violations=sum(len(outcome.violations) for outcome in outcomes),
        failed=[outcome.seed for outcome in outcomes if outcome.violations],
        lost=sum(bool(outcome.lost) for outcome in outcomes),
        first_valid_s=_spread([o.first_valid for o in outcomes if o.first_valid is not None]),
        refused=sum(outcome.refused for outcome in outcomes),
        lies=(sum(outcome.lied for outcome in outcomes), sum(outcome.named for outcome in outcomes)),
        undeclared=(sum(o.undeclared for o in outcomes), *_off([o for o in outcomes if o.undeclared])),
        kinds=[_kind("none", [o for o in outcomes if not o.faults], outcomes)]
        + [_kind(kind, [o for o in outcomes if kind in o.faults], outcomes) for kind in kinds],
    )


def _kind(kind: str, with_it: Sequence[Outcome], outcomes: Sequence[Outcome]) -> KindSummary:
    last = "" if kind == "none" else kind
    return KindSummary(
        kind=kind,
        injected=sum(outcome.faults.count(kind) for outcome in with_it),
        schedules=len(with_it),
        went_stale=sum(outcome.stale > 0.0 for outcome in with_it),
        violations=sum(len(outcome.violations) for outcome in with_it),
        off=_off(with_it),
        recovered_s=_spread([o.recovered for o in outcomes if o.last == last and o.recovered is not None]),
    )


def _off(outcomes: Sequence[Outcome]) -> tuple[int, int]:
    """Return ``KindSummary.off``."""
    times = [outcome.off_for for outcome in outcomes if outcome.off_for is not None]
    return len(times), sum(time > _LONG for time in times)


def _spread(values: Sequence[float]) -> tuple[float, float, float] | None:
    if not values:
        return None
    median, high, largest = np.quantile(values, [0.5, 0.95, 1.0]).round(2).tolist()
    return median, high, largest
