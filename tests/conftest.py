"""Settings and fixtures that all tests share."""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from coheft.wire.process.log import LOG
from tests.ports import PORTS_OF_PLANS

# Matrices are small, and several tests may run at a time: more threads would only wait for each other.
os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"), "1"))

# Always the same examples, so a test that passed once passes everywhere; no deadline, because machines differ.
settings.register_profile("coheft", derandomize=True, deadline=None, max_examples=60, database=None)
settings.register_profile("fuzz", deadline=None, max_examples=2000, print_blob=True)  # for 'make fuzz': always others
settings.load_profile("coheft")

# Started in the background by a shell, tests would ignore Ctrl-C, and so would all runs that they start and interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


os.environ["COHEFT_PORTS"] = PORTS_OF_PLANS

_REQUIRED = "--require-everything"
_LONG = ("test_batch_judge.py", "test_batch_judge_points.py", "test_batch_assumed.py", "test_team_changes.py")
"""Files without slow tests that take more than ten seconds all the same."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(_REQUIRED, action="store_true", help="a test that would be skipped fails")
    parser.addoption("--package", help="folder with the wheel and the sdist to be tested, instead of new ones")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """More than there are cores, because tests with processes, most of which are slow, wait for much of their time.

    Each worker imports all tests, which takes seconds.
    """
    return (os.cpu_count() or 1) + (1 if config.option.markexpr == "not slow" else 2)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that start processes are slow, but for those that show that it works at all.

    Files with the most slow tests come first, and then long ones, so that no worker is left with them at the end, when
    others have nothing to do any more; a worker takes all tests of a file, which share fixtures.
    """
    slow: Counter[Path] = Counter()
    for item in items:
        if "integration" in item.path.parts and item.get_closest_marker("smoke") is None:
            item.add_marker(pytest.mark.slow)
        slow[item.path] += item.get_closest_marker("slow") is not None
    items.sort(key=lambda item: (-slow[item.path], item.path.name not in _LONG))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.skipped and item.config.getoption(_REQUIRED) and not hasattr(report, "wasxfail"):
        report.outcome, report.longrepr = "failed", f"it may not be skipped here: {report.longrepr}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if report.skipped and collector.config.getoption(_REQUIRED):
        report.outcome, report.longrepr = "failed", f"it may not be skipped here: {report.longrepr}"
    return report


@pytest.fixture
def process_log() -> Iterator[None]:
    """The test writes the log of this process as a process of a run does; afterwards it is as it was."""
    handlers, level = LOG.handlers[:], LOG.level
    yield
    LOG.handlers[:], LOG.propagate = handlers, True
    LOG.setLevel(level)


@pytest.fixture
def own_state_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test does not see the runs of the user who runs it."""
    for name in ("XDG_STATE_HOME", "HOME"):
        monkeypatch.setenv(name, str(tmp_path / "state"))
