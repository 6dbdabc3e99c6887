"""The first Ctrl-C is noted, the second one is as usual."""

from __future__ import annotations

import signal
from threading import Thread

import pytest

from coheft.app.run.ctrl_c import FirstCtrlC


def test_the_first_is_noted_and_the_second_raised() -> None:
    with FirstCtrlC() as ctrl_c:
        assert not ctrl_c.take()
        signal.raise_signal(signal.SIGINT)
        assert ctrl_c.is_pressed
        assert [ctrl_c.take(), ctrl_c.take()] == [True, False]
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert ctrl_c.is_pressed


def test_afterwards_the_first_is_raised() -> None:
    with FirstCtrlC() as ctrl_c:
        pass
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)
    assert not ctrl_c.is_pressed


def test_where_it_is_ignored_it_remains_so() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with FirstCtrlC() as ctrl_c:
            signal.raise_signal(signal.SIGINT)
        assert not ctrl_c.is_pressed
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_leaves_it_alone() -> None:
    handlers = []

    def enter() -> None:
        with FirstCtrlC():
            handlers.append(signal.getsignal(signal.SIGINT))

    thread = Thread(target=enter)
    thread.start()
    thread.join()
    assert handlers == [signal.default_int_handler]
