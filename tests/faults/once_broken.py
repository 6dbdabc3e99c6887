"""Schedules of faults that once broke a promise."""

from __future__ import annotations

from coheft.app.faults.draw import draw_schedule
from tests.faults.drawn import drawn, plain

ONCE_BROKEN = (503, 1141, 1294, 1635, 2254, 2871, 3154, 4220, 5519, 5882)
"""As they are drawn, without ``DELAY``. Of those that broke former estimators, these and those below have each kind of
fault, most of them in several schedules."""
ONCE_BROKEN_LATE = (315, 583, 1119, 1955, 3585, 4631, 4645, 5921, 10195, 20091, 12697813, 31337081)
"""With it."""
ONCE_BROKEN_TOLD = (937973879, 937973933, 964694266, 964694870, 700000035)
"""As they are drawn, with errors of sensors that robots are told of."""
ONCE_BROKEN_AWAY = (
    1004225826,
    1012287590,
    1025733648,
    1025733695,
    1026664645,
    1034123404,
    1034123478,
    1036598359,
    1098941959,
)
"""As they are drawn: the load changes while a robot is away, or rows are damaged."""
ONCE_BROKEN_BY_UNSEEN_SLIPS = (
    1012287755,
    1012287842,
    1023698510,
    1026664730,
    1036598597,
    1036599028,
    1057616260,
    1059460205,
    1098942074,
    1098942515,
)
"""As they are drawn: a grasp slips while another robot is away, or its sensors are off; or contradicts repeatedly."""
ONCE_BROKEN_BY_DRIFTS = (1090000470, 1098942029)
"""As they are drawn: a leak makes poses wrong that are fitted along with it; drifting sensors look like a slip."""
DRAWN = {
    **{seed: plain(seed, delayed=False) for seed in ONCE_BROKEN},
    **{seed: plain(seed, delayed=True) for seed in ONCE_BROKEN_LATE},
    **{seed: drawn(seed, UNLIKE=0.0) for seed in ONCE_BROKEN_TOLD},
    **{seed: draw_schedule(seed) for seed in (*ONCE_BROKEN_AWAY, *ONCE_BROKEN_BY_UNSEEN_SLIPS, *ONCE_BROKEN_BY_DRIFTS)},
}
"""All these schedules."""
