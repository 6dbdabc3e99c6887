"""Recordings of runs from the command line, read back by libraries that know nothing of us."""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from coheft.app.cli.base import EXIT_CONVERGED
from coheft.app.cli.main import run_command_line
from coheft.app.recording.reader import read_recording
from coheft.app.recording.recover import Saved, recover
from coheft.errors import RecordingError
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Truth
from tests.integration.command_line import Run
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")


def last_messages(path: Path) -> dict[str, Any]:
    """The newest message of each topic, by a reader of ROS 2 bags."""
    newest: dict[str, Any] = {}
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            newest[connection.topic] = reader.deserialize(data, connection.msgtype)
    return newest


def count_messages(path: Path) -> int:
    """By the library of the file format."""
    counts: dict[str, int] = defaultdict(int)
    with path.open("rb") as file:
        for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] += 1
    return sum(counts.values())


def test_a_recording_says_what_the_report_says(start: Callable[..., Run], tmp_path: Path) -> None:
    path, target = tmp_path / "run.mcap", tmp_path / "report.json"
    run = start("--duration", "4", "--record", str(path), "--json", str(target))
    assert run.wait() in (0, 3), run.text
    assert "Traceback" not in run.text
    report = json.loads(target.read_text())
    newest = last_messages(path)
    for name, robot in report["robots"].items():
        inertia = newest[f"/{name}/estimate/payload"].inertia
        assert inertia.m == robot["mass"]["estimate"]
        assert [inertia.com.x, inertia.com.y, inertia.com.z] == robot["com"]["estimate"]
        tensor = robot["inertia"]["estimate"]
        assert [inertia.ixx, inertia.ixy, inertia.ixz] == tensor[0]
        assert [inertia.iyy, inertia.iyz, inertia.izz] == [*tensor[1][1:], tensor[2][2]]
        assert newest[f"/{name}/three_sigma/payload"].inertia.m == pytest.approx(3.0 * robot["mass"]["std"])
        error = newest[f"/{name}/error/payload"].inertia.m
        assert error == pytest.approx(robot["mass"]["estimate"] - robot["mass"]["truth"])
        for other, pose in robot["poses"].items():
            assert newest[f"/{name}/error/poses/{other}/rotation_deg"].data == pose["rotation_error_deg"]
            assert newest[f"/{name}/error/poses/{other}/translation_mm"].data == pose["translation_error_mm"]
    recording = read_recording(path)
    truths = [news for _, news in recording.news if isinstance(news, Truth)]
    assert [truth.block for truth in truths] == list(range(200)), "from the first block on, and all of them"
    assert truths[0].samples.shape == (3, 15)
    assert newest["/payload/inertia"].inertia.m == truths[-1].payload.mass
    assert recording.begin.scene.robots == list(report["robots"])
    assert json.loads(recording.scenario)["duration"] == 4.0
    assert count_messages(path) > 0
    assert run_command_line(["identify", str(path), "--json", str(tmp_path / "load.json")]) in (0, 3)
    load, truth = json.loads((tmp_path / "load.json").read_text())["payload"], truths[-1].payload
    assert load["mass_kg"] == pytest.approx(truth.mass, abs=5.0 * load["mass_std_kg"])


def saved_so_far(path: Path, scratch: Path) -> Saved | None:
    """What could be saved if the run were killed now."""
    if not path.exists():
        return None
    scratch.with_suffix(".copy").write_bytes(path.read_bytes())
    try:
        return recover(scratch.with_suffix(".copy"), scratch, overwrite=True)
    except RecordingError:
        return None


def times_of_truth(path: Path) -> list[float]:
    return [time for time, news in read_recording(path).news if isinstance(news, Truth)]


def test_a_run_that_is_killed_leaves_all_but_its_last_second(start: Callable[..., Run], tmp_path: Path) -> None:
    """Nothing happens while the run is paused, so a second later all that was heard must be on its way to the disk."""
    path, scratch = tmp_path / "run.mcap", tmp_path / "scratch.mcap"
    run = start("--duration", "10000", "--record", str(path))
    run.wait_for_results()
    status, text = run.ask("pause")
    assert status == 0, text
    paused_at = float(text.split("paused at ")[1].split(" s")[0])

    def is_complete() -> bool:
        # A robot's estimate for the last block may reach the disk before the server's truth for it.
        saved = saved_so_far(path, scratch)
        return saved is not None and times_of_truth(scratch)[-1] >= paused_at - 1e-6

    wait_until(is_complete, f"the recording to reach {paused_at} s")
    run.supervisor.kill()
    run.wait()
    wait_until(lambda: run.left() == [], "all processes to notice that their supervisor is gone")
    with pytest.raises(RecordingError, match="coheft recover"):
        read_recording(path)

    output = tmp_path / "saved.mcap"
    assert run_command_line(["recover", str(path), "--output", str(output)]) == EXIT_CONVERGED
    recording = read_recording(output)
    times = times_of_truth(output)
    assert times[-1] == pytest.approx(paused_at)
    assert len(times) == round(paused_at / times[0]), "no block is missing"
    assert any(isinstance(news, Estimate) for _, news in recording.news)
    newest = last_messages(output)
    assert newest["/payload/pose"].header.frame_id == "world"
    assert count_messages(output) > len(recording.news)
