"""Recordings of a run whose outcome is known by construction."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coheft.app.recording.mcap_file import McapFile
from coheft.app.recording.writer import RunWriter
from coheft.app.run.news import News
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.wire.messages.requests import RunState, Status
from coheft.wire.messages.structs import LoadChangeNotice, Problem
from coheft.wire.scenario.file import load_scenario
from tests.synthetic_run import BLOCK, HEAVY, LIGHT, ROBOTS, SCENE, estimate, truth

SCENARIO = load_scenario("ring3")
BEGIN = Status(
    scenario="ring3",
    state=RunState.RUNNING, block=0, time=0.0, duration=20 * BLOCK, real_time_factor=0.0, late_blocks=0,
    loads=[], slots_free=4, waiting_for=[], estimator="efficient",
    estimators=["efficient", "fan2017"], scene=SCENE,
)  # fmt: skip


def mistaken_for(payload: Inertia) -> Inertia:
    """What all robots take it for."""
    return Inertia(1.1 * payload.mass, payload.com + np.array([0.01, -0.02, 0.03]), 0.8 * payload.tensor)


def news_of_a_run(blocks: int = 20) -> list[News]:
    """A load comes at half time; the robots notice at once. Estimates of r1 come before the truth about them."""
    news: list[News] = []
    for block in range(blocks):
        payload = LIGHT if block < blocks // 2 else HEAVY
        changes = [LoadChangeNotice((block + 1) * BLOCK, blocks // 2 * BLOCK)] if block == blocks // 2 else []
        estimates = {
            name: estimate(name, block, mistaken_for(payload), changes=changes, wrench_error=0.1) for name in ROBOTS
        }
        news += [estimates["r1"], truth(block, payload), estimates["r2"], estimates["r3"]]
        if block == 3:
            news.append(Problem(source="r2", text="refused something"))
    return news


def record(path: Path, news: Sequence[News], *, finish: bool = True) -> Path:
    """Write a recording in one go."""
    with path.open("wb") as file:
        out = McapFile(file)
        run = RunWriter(out, SCENARIO, BEGIN)
        for number, each in enumerate(news):
            run.receive(each)
            if number % 16 == 0:
                out.flush()
        if finish:
            out.finish()
        else:
            out.flush()
    return path


def same(one: object, other: object) -> bool:
    """Whether two messages are equal, bit for bit, their arrays included."""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.shape == other.shape and one.tobytes() == other.tobytes()
    if isinstance(one, list):
        return isinstance(other, list) and len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, dict):
        return isinstance(other, dict) and one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if hasattr(one, "__struct_fields__"):
        return type(one) is type(other) and all(
            same(getattr(one, field), getattr(other, field)) for field in one.__struct_fields__
        )
    return one == other
