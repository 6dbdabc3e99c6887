"""Campaigns: the same whenever they are run, resumed where they were cut off; and deliberate bugs that they find."""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import msgspec
import pytest

from coheft.app.faults import campaign
from coheft.app.faults.campaign import OutcomeFile, run_campaign
from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import Violation, Watch
from coheft.app.faults.mutants import MUTANTS, mutated
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import (
    AnyFault,
    ClockSkew,
    Crash,
    FaultSchedule,
    Replay,
    SensorFault,
    is_harmless,
)
from coheft.app.faults.summary import summarise
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.errors import CoheftError
from coheft.estimation.tolerance import INDUSTRIAL
from coheft.wire.messages.codec import encode
from coheft.wire.scenario.schema import LoadChange
from tests.efficient import test_guards
from tests.faults.drawn import drawn, plain

OUTCOME = Outcome(
    seed=3,
    faults=("crash", "loss"),
    last="loss",
    simulated=9.0,
    violations=[Violation("P1", 3.0, "r1", "payload: mass off", 6.0)],
    first_valid=2.0,
    recovered=1.0,
    stale=0.1,
    refused=2,
    lied=1,
    named=1,
)
_replace = msgspec.structs.replace

ONCE_BROKEN = (503, 1141, 1294, 1635, 2045, 2254, 2532, 2871, 3154, 3690, 4220, 5519, 5882, 6907, 7069, 9708)
"""As they are drawn, without ``DELAY``. Of those that broke former estimators, these have each kind of fault twice."""
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
WITH_HARMLESS = (583, 3585, 12697813)
"""Compared with runs without their duplicates, replays and malformed messages; others are run without these."""
LONG_ENOUGH = {
    1119: 11.4,
    937973879: 9.1,
    1025733695: 11.0,
    1090000470: 6.0,
    1098941959: 11.6,
    1098942074: 5.4,
    1098942515: 9.9,
}
"""How long a schedule is run that broke its promise before, and recovers long afterwards, or again and again [s]."""
ONCE_DRAWN = "1d986c0fdeb75620dbb5f4c8339d0a5478470edffb71579d954b91e665c62d31"
"""Digest of those of ``ONCE_BROKEN``, ``ONCE_BROKEN_LATE`` and ``ONCE_BROKEN_TOLD``."""


_CALM = _replace(plain(14), faults=())
_OFF = drawn(31, LASTING=0.0, UNLIKE=0.0)
_LATE = _replace(
    _OFF,
    scenario=_replace(
        _OFF.scenario,
        load_changes=(),
        duration=8.0,
        sensors=_replace(_OFF.scenario.sensors, tolerance=_replace(INDUSTRIAL, clock=2e-5, wrench_delay=2e-5)),
    ),
    faults=(ClockSkew(start=0.0, end=1.5, seed=0, robot="r2", samples=1),),
)
"""A clock is late, which scales and mountings of sensors explain, if they may be as large as they like."""
_AWAY_ONCE = draw_schedule(1012287590)
_AWAY_ONCE = _replace(_AWAY_ONCE, faults=_AWAY_ONCE.faults[:1])
"""A robot lets go, and is back after a second: small changes of the load meanwhile."""
SHOWN_BY = {
    "half-complete-row": _CALM,
    "wrong-row": _CALM,
    "no-lever-arm": _CALM,
    "wrong-side": plain(1635, delayed=False),
    "no-rival": plain(2254, delayed=False),
    "no-confirmation": plain(883),
    "endless-confirmation": _AWAY_ONCE,
    "rare-fits": draw_schedule(1062000043),
    "without-fresh-change": plain(4220, delayed=False),
    "without-tolerance": _LATE,
    "without-restless": draw_schedule(1026664730),
    "without-outdated": draw_schedule(1012287755),
    "without-doubted": draw_schedule(1012287842),
    "without-first-rows": plain(878, delayed=False),
}
"""A schedule for each mutant."""
WITHIN = {
    "no-confirmation": 0.5,
    "endless-confirmation": 2.4,
    "rare-fits": 0.7,
    "without-tolerance": 1.5,
    "without-restless": 6.4,
    "without-doubted": 3.5,
    "without-first-rows": 1.0,
}
"""How soon after the last fault robots are valid again without the mutant [s], if not after 3 s; no run goes on."""


def one_of_each_kind() -> dict[str, FaultSchedule]:
    """Runs of 1 s with one fault each, all kinds of them; by kind."""
    found: dict[str, FaultSchedule] = {}
    for seed in range(400):
        schedule = draw_schedule(seed)
        scenario = _replace(schedule.scenario, duration=1.0, load_changes=())
        for fault in schedule.faults:
            if fault.kind not in found:
                faults: tuple[AnyFault, ...] = (_replace(fault, start=0.2, end=0.8),)
                if isinstance(fault, Replay) and fault.source == "former incarnation":
                    # Without a restart of the sender there is none.
                    faults = (_replace(faults[0], sender="r1"), Crash(start=0.2, end=0.3, robot="r1"))
                found[fault.kind] = _replace(schedule, scenario=scenario, faults=faults)
    return found


EACH_KIND = one_of_each_kind()


def test_equal_schedules_give_equal_runs_bit_for_bit():
    schedule = plain(332)
    runs = [iter(FaultyRun(schedule)) for _ in range(2)]
    for _ in range(40):
        said = [next(run).outboxes for run in runs]
        first, second = ([encode(box.message, "") for box in boxes.values()] for boxes in said)
        assert first == second


@pytest.mark.slow
def test_a_run_that_parts_from_another_goes_on_as_that_one_does():
    schedule = plain(332)
    change = LoadChange(at=1.5, mass=1.0)
    run = FaultyRun(_replace(schedule, scenario=_replace(schedule.scenario, load_changes=(change,)), faults=()))
    for _ in range(20):
        next(iter(run))
    parted = run.without_harmless()
    for here, there in itertools.islice(zip(run, parted, strict=True), 60):
        assert encode(there.truth, "") == encode(here.truth, "")
        for name, box in here.outboxes.items():
            assert encode(there.outboxes[name].message, "") == encode(box.message, "")


def test_a_campaign_goes_on_where_it_was_cut_off(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    tried: list[int] = []

    def count(seed: int, mutant: str = "", values: Sequence[str] = ()) -> Outcome:
        tried.append(seed)
        return _replace(OUTCOME, seed=seed)

    monkeypatch.setattr(campaign, "try_seed", count)
    kept = tmp_path / "outcomes"
    list(run_campaign(range(3), jobs=1, kept=kept))
    kept.write_bytes(kept.read_bytes()[:-20])  # cut off within the last line
    outcomes = list(run_campaign(range(5), jobs=1, kept=kept))
    assert tried == [0, 1, 2, 2, 3, 4]
    assert [outcome.seed for outcome in outcomes] == [0, 1, 2, 3, 4]
    assert [outcome.seed for outcome in OutcomeFile(kept).begin()] == [0, 1, 2, 3, 4]
    assert [outcome.seed for outcome in run_campaign([4], jobs=1, kept=kept)] == [4]
    assert [outcome.seed for outcome in OutcomeFile(kept).begin()] == [0, 1, 2, 3, 4]  # also those not asked for


def test_a_header_without_its_end_of_line_is_written_again(tmp_path: Path):
    kept = tmp_path / "outcomes"
    OutcomeFile(kept).begin()
    kept.write_bytes(kept.read_bytes().rstrip(b"\n"))
    file = OutcomeFile(kept)
    assert file.begin() == []
    file.append(OUTCOME)
    assert OutcomeFile(kept).begin() == [OUTCOME]


def test_what_other_code_a_mutant_or_somebody_else_has_left_stays_as_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    kept = tmp_path / "outcomes"
    file = OutcomeFile(kept)
    file.begin()
    file.append(OUTCOME)
    assert file.begin() == [OUTCOME]
    content = kept.read_bytes()
    with pytest.raises(CoheftError, match=r"outcomes contains outcomes of another mutant, or of another --set: name"):
        list(run_campaign([1], kept=kept, mutant="wrong-row"))
    with pytest.raises(CoheftError, match=r"outcomes contains outcomes of another mutant, or of another --set: name"):
        list(run_campaign([1], kept=kept, values=["sensors.rate=200"]))
    monkeypatch.setattr(campaign, "code_hash", lambda: "other")
    with pytest.raises(CoheftError, match=r"outcomes is of other code: name another file"):
        list(run_campaign([1], kept=kept))
    assert kept.read_bytes() == content
    for foreign in ("text", '{"name": "r1"}'):
        kept.write_text(foreign)
        with pytest.raises(CoheftError, match=r"outcomes is not a file of outcomes: name another file"):
            list(run_campaign([1], kept=kept))
        assert kept.read_text() == foreign


def test_a_summary_counts_what_happened():
    good = _replace(OUTCOME, seed=4, faults=(), last="", violations=[], recovered=3.0, stale=0.0, lied=0, named=0)
    worse = _replace(OUTCOME, seed=5, violations=[], faults=("loss", "loss"), recovered=2.0)
    summary = summarise([OUTCOME, good, worse])
    assert (summary.seeds, summary.schedules, summary.violations, summary.failed) == ((3, 5), 3, 1, [3])
    assert summary.lies == (2, 2)
    by_kind = {kind.kind: kind for kind in summary.kinds}
    assert (by_kind["loss"].injected, by_kind["loss"].schedules, by_kind["loss"].went_stale) == (3, 2, 2)
    assert by_kind["loss"].recovered_s == (1.5, 1.95, 2.0)
    assert by_kind["crash"].recovered_s is None
    assert by_kind["none"].recovered_s == (3.0, 3.0, 3.0)


@pytest.mark.parametrize("kind", EACH_KIND)
def test_every_kind_of_fault_is_survived_while_agents_start(kind: str):
    """Nothing raises, and what is harmless makes no difference."""
    outcome = try_schedule(EACH_KIND[kind])
    assert outcome.simulated == pytest.approx(1.0, abs=0.1)
    assert outcome.violations == []


@pytest.mark.parametrize("mutant", MUTANTS)
def test_a_mutant_leaves_nothing_behind(mutant: str):
    owner, method, _ = MUTANTS[mutant]
    right = getattr(owner, method)
    with mutated(mutant):
        assert getattr(owner, method) is not right
    assert getattr(owner, method) is right


def test_for_every_mutant_there_is_a_test_that_finds_it():
    of_guards = {f"without-{guard.replace('_', '-')}" for guard in test_guards.CASES}
    assert set(MUTANTS) == {*SHOWN_BY, *of_guards}


@pytest.mark.slow
@pytest.mark.parametrize("mutant", SHOWN_BY)
def test_every_deliberate_bug_is_found(mutant: str):
    """By a number that is wrong, or because no robot is ever valid; without the bug neither happens."""
    schedule, within = SHOWN_BY[mutant], WITHIN.get(mutant, 3.0)
    if schedule not in DRAWN.values():  # else ``assert_keeps_all_promises`` says so
        assert not goes_wrong_unmutated(msgspec.json.encode(schedule), within)
    with mutated(mutant):
        assert goes_wrong(schedule, within)


@cache
def goes_wrong_unmutated(encoded: bytes, within: float) -> bool:
    """Schedules of several mutants are run once."""
    return goes_wrong(msgspec.json.decode(encoded, type=FaultSchedule), within)


def goes_wrong(schedule: FaultSchedule, within: float) -> bool:
    run, latest = FaultyRun(schedule), {}
    watch = Watch(schedule, run.scene)
    calm = max([schedule.last_fault_end, 0.0, *(change.at for change in schedule.scenario.load_changes)])
    for block in run:
        watch.check(block)
        latest |= {name: outbox.estimate for name, outbox in block.outboxes.items() if outbox.estimate is not None}
        if watch.violations or block.truth.time > calm + within:
            break
    return bool(watch.violations) or {estimate.status for estimate in latest.values()} != {"valid"}


@pytest.mark.parametrize(("team", "start"), [(1, 1.8), (3, 1.0), (8, 1.0), (11, 1.0)])
def test_a_sensor_that_was_off_while_poses_were_rough_spoils_no_estimate(team: int, start: float):
    """It does not show at the time: samples are summed again as soon as poses are good enough."""
    schedule = plain(team)
    scenario = _replace(schedule.scenario, duration=5.0, load_changes=())
    offset = SensorFault(start=start, end=start + 0.6, robot="r1", sensor="force", how="offset", size=5.0)
    outcome = try_schedule(_replace(schedule, scenario=scenario, faults=(offset,)))
    assert outcome.first_valid is not None
    assert outcome.violations == []


@pytest.mark.slow
@pytest.mark.parametrize(("size", "later"), [(4.0, 0.0), (10.0, 0.7), (4.0, 1.1)])
def test_a_force_sensor_that_goes_a_little_off_is_not_taken_for_another_load(size: float, later: float):
    """One that pushes more or less upwards looks like weight, until the load has turned."""
    schedule = plain(10195)
    (offset,) = (fault for fault in schedule.faults if isinstance(fault, SensorFault))
    offset = _replace(offset, start=offset.start + later, end=offset.end + later, size=size)
    outcome = try_schedule(_replace(schedule, faults=(offset,)))
    assert outcome.violations == []
    assert outcome.recovered is not None
    assert outcome.recovered < 1.0


def test_what_is_drawn_for_these_seeds_is_still_what_was_once_broken():
    """If not, take them from the version before, and keep them as files (``write_schedule``)."""
    drawn = [DRAWN[seed] for seed in (*ONCE_BROKEN, *ONCE_BROKEN_LATE, *ONCE_BROKEN_TOLD)]
    assert hashlib.sha256(msgspec.json.encode(drawn)).hexdigest() == ONCE_DRAWN


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN)
def test_schedules_that_once_broke_a_promise_keep_them_all(seed: int):
    assert_keeps_all_promises(DRAWN[seed])


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN_LATE)
def test_late_schedules_that_once_broke_a_promise_keep_them_all(seed: int):
    assert_keeps_all_promises(DRAWN[seed])


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN_AWAY)
def test_schedules_in_which_the_load_changes_while_a_robot_is_away_keep_all_promises(seed: int):
    assert_keeps_all_promises(DRAWN[seed])


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN_BY_UNSEEN_SLIPS)
def test_schedules_in_which_a_grasp_slips_unseen_keep_all_promises(seed: int):
    assert_keeps_all_promises(DRAWN[seed])


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN_BY_DRIFTS)
def test_schedules_in_which_loads_or_sensors_drift_keep_all_promises(seed: int):
    assert_keeps_all_promises(DRAWN[seed])


@pytest.mark.slow
@pytest.mark.parametrize("seed", ONCE_BROKEN_TOLD)
def test_schedules_with_errors_that_robots_are_told_of_keep_all_promises(seed: int):
    """What the newest rows can be explained by, as a pose is unknown, is no confirmation of the load known before."""
    assert_keeps_all_promises(DRAWN[seed])


def assert_keeps_all_promises(schedule: FaultSchedule) -> None:
    """If it shows deliberate bugs, robots are valid again as soon as these tests expect it without the bugs."""
    compared = schedule.seed in WITH_HARMLESS
    faults = tuple(fault for fault in schedule.faults if compared or not is_harmless(fault))
    duration = LONG_ENOUGH.get(schedule.seed, schedule.scenario.duration)
    outcome = try_schedule(_replace(schedule, faults=faults, scenario=_replace(schedule.scenario, duration=duration)))
    assert outcome.violations == []
    for mutant in (mutant for mutant, shown in SHOWN_BY.items() if shown == schedule):
        assert outcome.recovered is not None
        assert outcome.recovered <= WITHIN.get(mutant, 3.0)
