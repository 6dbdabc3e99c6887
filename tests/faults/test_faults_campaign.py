"""Campaigns: the same whenever they are run, resumed where they were cut off; and deliberate bugs that they find."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest

from coheft.app.faults import campaign
from coheft.app.faults.campaign import OutcomeFile, run_campaign
from coheft.app.faults.draw import draw_schedule
from coheft.app.faults.invariants import Violation
from coheft.app.faults.run import FaultyRun
from coheft.app.faults.schedule import (
    AnyFault,
    Crash,
    FaultSchedule,
    Replay,
    SensorFault,
)
from coheft.app.faults.summary import summarise
from coheft.app.faults.trial import Outcome, try_schedule
from coheft.errors import CoheftError
from coheft.wire.messages.codec import encode
from coheft.wire.scenario.schema import LoadChange
from tests.faults.drawn import plain

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


def one_of_each_kind() -> dict[str, FaultSchedule]:
    """Runs of 1 s with one fault each, all kinds of them; by kind."""
    found: dict[str, FaultSchedule] = {}
    for seed in range(102):
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
