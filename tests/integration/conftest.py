"""Fixtures that tests with processes share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.integration.command_line import Run


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
