"""Answers that come too late are counted, and told now and then."""

from __future__ import annotations

from coheft.physics_server.late_answers import TELL_EVERY, LateAnswers

BLOCK = 0.02


def told(late: dict[int, list[str]], blocks: int) -> tuple[LateAnswers, list[str]]:
    """What is told in so many blocks, if these robots were late for these blocks."""
    answers = LateAnswers()
    lines = [answers.add(late.get(block, []), block * BLOCK) for block in range(blocks)]
    return answers, [line for line in lines if line is not None]


def test_nothing_is_told_as_long_as_nobody_is_late() -> None:
    answers, lines = told({}, 1000)
    assert (answers.count, lines) == (0, [])


def test_the_first_one_is_told_at_once_and_only_once() -> None:
    answers, lines = told({91: ["r1", "r2"]}, 1000)
    assert answers.count == 2
    assert lines == ["r1, r2 answered too late at 1.82 s; further late answers are counted"]


def test_a_machine_that_is_too_slow_is_told_of_every_few_seconds_with_a_count() -> None:
    late = {block: ["r1", "r2"] if block % 2 else ["r2"] for block in range(1000)}
    answers, lines = told(late, 1000)
    assert answers.count == 1500
    assert len(lines) == 20.0 / TELL_EVERY
    assert lines[1] == "376 answers were late in the first 5.0 s; of the newest, most came from r2"


def test_what_came_before_a_silence_is_told_when_it_is_time() -> None:
    answers, lines = told({10: ["r1"], 11: ["r3"]}, 1000)
    assert answers.count == 2
    assert lines[1:] == ["2 answers were late in the first 5.2 s; of the newest, most came from r3"]
