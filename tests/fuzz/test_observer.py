"""Whatever comes under the keys of a run, whoever watches it refuses it, or can show it and report on it."""

from __future__ import annotations

import io
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rich.console import Console

from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.writer import RunWriter
from coheft.app.results.record import Record
from coheft.app.run.news import News, check_news
from coheft.app.terminal.final_table import print_report
from coheft.app.terminal.screen import LineDisplay, LiveDisplay
from coheft.app.versions import versions
from coheft.errors import MessageError
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Estimate, LoadChangeNotice, Message, Problem, Validity
from coheft.wire.messages.truth import Truth
from tests.fuzz.any_message import (
    KEY,
    altered,
    array_extensions,
    fields_of,
    trees,
    values,
    with_a_part_replaced,
    with_fields,
)
from tests.recording.runs import BEGIN, SCENARIO
from tests.synthetic_run import HEAVY, LIGHT, ROBOTS, SCENE, built_report, estimate, truth

SOUND: list[Message] = [
    truth(11, HEAVY),
    estimate("r1", 11, HEAVY),
    msgspec.structs.replace(
        estimate("r1", 11, HEAVY, changes=[LoadChangeNotice(0.15, 0.1)]),
        status=Validity.STALE,
        reasons=["r2 is silent"],
    ),
]


@pytest.fixture(scope="module", autouse=True)
def versions_once() -> Iterator[None]:
    """Looked up for every recording, they take a sixth of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("coheft.app.recording.writer.versions", cache(versions))
        yield


def record_of_a_run() -> Record:
    record = Record(SCENE, duration=4.0, with_history=True)
    for block in range(10):
        record.receive(truth(block, LIGHT if block < 5 else HEAVY))
        for name in ROBOTS:
            record.receive(estimate(name, block, LIGHT))
    return record


def record_on(news: News) -> None:
    """What the rest of a run is written to after this."""
    out = McapFile(io.BytesIO())
    run = RunWriter(out, SCENARIO, BEGIN)
    for each in (truth(10, LIGHT), estimate("r1", 11, LIGHT), news, truth(11, HEAVY), estimate("r1", 12, HEAVY)):
        run.receive(each)
    out.finish()


def receive_show_and_report(message: Message) -> None:
    record = record_of_a_run()
    try:
        news = check_news("r1", message, SCENE)
    except MessageError:
        return
    assert news is not None
    record.receive(news)
    record_on(news)
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    for display in (LiveDisplay(console), LineDisplay(console)):
        with display:
            display.update(record)
            if isinstance(news, Problem):
                assert news.source == "r1"
                display.problem(news)
    for name in ROBOTS:
        record.receive(estimate(name, 12, HEAVY))
    record.receive(truth(20, LIGHT))
    report = built_report(record)
    msgspec.json.encode(report)
    print_report(console, report, Path("logs"))


@given(data=st.data())
def test_a_sound_message_with_something_else_in_a_place(data: st.DataObject) -> None:
    sound = data.draw(st.sampled_from([*SOUND, Problem(source="r1", text="?")]))
    said = encode(sound, KEY)
    changed = data.draw(with_a_part_replaced(fields_of(said), st.floats() | array_extensions() | trees()))
    try:
        message = decode(with_fields(said, msgspec.msgpack.encode(changed)), type(sound), KEY)
    except MessageError:
        return
    receive_show_and_report(message)


@pytest.mark.slow
@settings(max_examples=5 * settings.default.max_examples)
@given(message=st.sampled_from(SOUND).flatmap(altered))
def test_a_sound_message_with_another_value_in_a_place(message: Message) -> None:
    receive_show_and_report(message)


@given(message=values(Estimate) | values(Truth) | values(Problem))
def test_any_message(message: Message) -> None:
    receive_show_and_report(message)


def test_no_robot_speaks_for_another() -> None:
    with pytest.raises(MessageError, match="robot is 'r2' but expected 'r1'"):
        check_news("r1", estimate("r2", 11, HEAVY), SCENE)
