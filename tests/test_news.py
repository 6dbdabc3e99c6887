"""What an observer takes for the status of a run, or for news of it, and what not."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
import pytest

from coheft.app.run.news import check_news, check_status
from coheft.errors import MessageError
from coheft.wire.messages.requests import Status
from coheft.wire.messages.structs import Problem
from coheft.wire.messages.truth import BoxShape
from tests.recording.runs import BEGIN
from tests.synthetic_run import SCENE

NOT_A_NUMBER = float("nan")


def status(**parts: Any) -> Status:
    """The status of a run with something else in its scene."""
    return msgspec.structs.replace(BEGIN, scene=msgspec.structs.replace(SCENE, **parts))


def test_a_run_has_a_status() -> None:
    check_status(BEGIN)
    check_status(status(boxes=[BoxShape((0.1, 0.2, 0.3), (0.0, 0.0, 0.1), (0.0, 0.0, 45.0))]))


@pytest.mark.parametrize(
    ("parts", "complaint"),
    [
        ({"robots": []}, "without duplicates"),
        ({"robots": ["r1", "r2", "r2"]}, "without duplicates"),
        ({"rotations": SCENE.rotations[:2]}, "rotations"),
        ({"rotations": 1.01 * SCENE.rotations}, "r1"),
        ({"rotations": SCENE.rotations[:, :, [1, 0, 2]]}, "r1"),
        ({"translations": SCENE.translations[:, :2]}, "translations"),
        ({"translations": np.full((3, 3), np.inf)}, "translations"),
        ({"translations": np.diag([-(2**63), 1, 1])}, "translations.dtype is 'int64' but expected 'float64'"),
        ({"neighbours": {**SCENE.neighbours, "r9": ["r1"]}}, "robots of the graph"),
        ({"neighbours": {"r1": ["r2"]}}, "robots of the graph"),
        ({"neighbours": {**SCENE.neighbours, "r1": ["r9"]}}, "'r9' but expected one of 'r1', 'r2'"),
        ({"home": (0.0, NOT_A_NUMBER, 1.0)}, "number of the scene"),
        ({"boxes": [BoxShape((0.1, NOT_A_NUMBER, 0.3), (0.0, 0.0, 0.1), (0.0, 0.0, 0.0))]}, "number of the scene"),
    ],
)
def test_a_scene_that_cannot_be_is_refused(parts: dict[str, Any], complaint: str) -> None:
    with pytest.raises(MessageError, match=complaint):
        check_status(status(**parts))


def test_the_estimator_in_use_is_one_of_those_that_there_are() -> None:
    with pytest.raises(MessageError, match="estimator is 'guess' but expected one of"):
        check_status(msgspec.structs.replace(BEGIN, estimator="guess"))


@pytest.mark.parametrize(("source", "is_end"), [("server", True), ("r1", False)])
def test_only_the_server_says_that_a_run_ends(source: str, is_end: bool) -> None:
    heard = check_news(source, Problem(source="server", text="all is\nover", is_end=True), SCENE)
    assert heard == Problem(source=source, text="all is\\nover", is_end=is_end)
