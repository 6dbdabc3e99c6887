"""What is asked of a run that goes on: loads, links, grasps."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from coheft.app.run.observer import ask_run
from coheft.wire.messages.requests import StatusRequest
from tests.integration.command_line import Run
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


def test_loads_come_and_go_in_a_run_and_nonsense_is_refused(start: Callable[..., Run], tmp_path: Path) -> None:
    target = tmp_path / "injected.json"
    run = start("--realtime", "--duration", "10000", "--change", "t=9999,mass=1", "--json", str(target))
    run.wait_until_under_way()

    status, text = run.ask("inject", "--mass", "-3", "--at", "0", "0", "0.1")
    assert status == 1
    assert "refused" in text
    assert "mass" in text

    for number in range(1, 5):
        status, text = run.ask("inject", "--mass", "0.5", "--at", "0.1", "0", "0.1", "--size", "0.2", "0.1", "0.05")
        assert status == 0, text
        assert f"load {number} (0.5 kg)" in text
    wanted = [(0.5, (0.1, 0.0, 0.1), (0.2, 0.1, 0.05))] * 4
    assert [(load.mass, load.position, load.size) for load in ask_run(StatusRequest(), run.folder).loads] == wanted
    status, text = run.ask("inject", "--mass", "0.5", "--at", "0.1", "0", "0.1")
    assert status == 1
    assert "refused" in text
    assert "4" in text, "how many there may be"

    status, text = run.ask("remove", "7")
    assert status == 1
    assert "7" in text
    status, text = run.ask("remove", "2")
    assert status == 0, text

    status, text = run.ask("pause")
    assert status == 0, text
    assert "paused" in text
    status, text = run.ask("resume")
    assert status == 0, text

    status, text = run.ask("stop")
    assert status == 0, text
    assert run.wait() in (0, 3), run.text
    assert run.left() == []
    changes = json.loads(target.read_text())["load_changes"]
    masses = [change["truth"]["mass"] for change in changes]
    assert len(masses) == 5
    assert [after - before for before, after in pairwise(masses)] == pytest.approx([0.5, 0.5, 0.5, -0.5])


def test_links_are_cut_and_mended_and_robots_let_go_and_take_hold(start: Callable[..., Run]) -> None:
    run = start("--realtime", "--duration", "10000")
    run.wait_until_under_way()
    for command, words, log, done in (
        ("cut r1 r2", "r1 and r2 no longer receive each other's messages", "r2", "has cut the link with r1"),
        ("mend r1 r2", "r1 and r2 can receive each other's messages again", "r2", "has mended the link with r1"),
        ("disturb r1 r2 --loss 0.1", "between r1 and r2: 10 % lost; ", "r2", "link from r1: 10 % lost"),
        (
            "disturb r1 --delay 0.1",
            "between r1 and its neighbours: 0.1 s late",
            "r3",
            "link from r1: 0.1 s late",
        ),
        (
            "disturb r1 --clock 0.003",
            "the clock of r1 is 0.003 s ahead; 'coheft disturb r1'",
            "server",
            "r1: 0.003 s ahead",
        ),
        ("disturb r1", "the clock of r1 is right again", "server", "has restored the clock of r1"),
        ("disturb r1 --clock 0", "the clock of r1 is right again", "r2", "has restored the link from r1"),
        ("release r2", "r2 released the payload at", "server", "let r2 release the payload"),
        ("grasp r2", "r2 grasped the payload at", "server", "let r2 grasp the payload again"),
    ):
        status, text = run.ask(*command.split())
        assert status == 0, text
        assert words in " ".join(text.split())
        wait_until(lambda log=log, done=done: done in (run.folder / f"{log}.log").read_text(), done)
    for command, complaint in (
        ("cut r1 r9", "there is no link r1-r9; the links are r1-r2, r1-r3, r2-r3"),
        ("release r9", "no robot r9: the robots are r1, r2, r3"),
        ("disturb r9 --clock 0.1", "no robot r9: the robots are r1, r2, r3"),
        ("disturb r9 --loss 0.1", "no robot r9: the robots are r1, r2, r3"),
        ("disturb r1 r2 --clock 0.1", "a clock is one robot's: leave out r2, or --clock"),
    ):
        status, text = run.ask(*command.split())
        assert status == (2 if "leave out" in complaint else 1)
        assert complaint in " ".join(text.split())
    assert run.ask("stop")[0] == 0
    assert run.wait() in (0, 3), run.text
