"""Fixtures that tests with processes share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from coheft.app.run.keys import make_keys
from tests.integration.attacker import Profile
from tests.integration.command_line import Run
from tests.integration.team import small_scenario


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[..., Run]]:
    """Starts runs of three robots, and sees to it that none is left after a failed test."""
    runs: list[Run] = []

    def start_run(*arguments: str) -> Run:
        runs.append(Run(tmp_path / f"run{len(runs)}", "ring3", *arguments))
        return runs[-1]

    yield start_run
    for run in runs:
        run.end()


@pytest.fixture(scope="module")
def secure(tmp_path_factory: pytest.TempPathFactory) -> Profile:
    """The keys of a team of four; they stay as they are."""
    folder = tmp_path_factory.mktemp("team") / "keys"
    make_keys(folder, small_scenario(4))
    return Profile(folder)
