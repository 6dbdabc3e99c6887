"""The first Ctrl-C is noted, the second one is as usual."""

from __future__ import annotations

import signal
from threading import Thread

import pytest

from coheft.app.run.ctrl_c import FirstCtrlC


def test_the_first_is_noted_and_the_second_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("coheft.app.run.ctrl_c.time.monotonic", lambda: now)
    now = 5.0
    with FirstCtrlC() as ctrl_c:
        ctrl_c.begin()
        assert not ctrl_c.take()
        for _ in range(2):  # as if a wrapper forwarded it
            signal.raise_signal(signal.SIGINT)
        assert ctrl_c.is_pressed
        assert [ctrl_c.take(), ctrl_c.take()] == [True, False]
        now = 6.0
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert ctrl_c.is_pressed


def test_afterwards_the_first_is_raised() -> None:
    with FirstCtrlC() as ctrl_c:
        ctrl_c.begin()
        ctrl_c.end()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert not ctrl_c.is_pressed


def test_where_it_is_ignored_it_remains_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with FirstCtrlC() as ctrl_c:
            ctrl_c.begin()
            signal.raise_signal(signal.SIGINT)
        assert not ctrl_c.is_pressed
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_leaves_it_alone() -> None:
    handlers = []

    def enter() -> None:
        with FirstCtrlC() as ctrl_c:
            ctrl_c.begin()
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = Thread(target=enter)
    thread.start()
    thread.join()
    assert handlers == [signal.default_int_handler]
