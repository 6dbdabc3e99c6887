"""Recorded messages of agents, which ``benchmarks.bare_agent`` repeats."""

import statistics
from collections import deque
from pathlib import Path

import msgspec

from benchmarks.scenarios import SETTLED
from coheft.app.run.inprocess import TeamInProcess, measured
from coheft.wire.messages.codec import decode, encode
from coheft.wire.messages.structs import Estimate, NeighbourMessage, Reference
from coheft.wire.scenario.schema import Scenario

BLOCKS = 50
"""Number of consecutive blocks that are recorded and repeated."""
SETTING = "replay"
"""Key of the estimator's settings for an agent's file."""
_KEY = "replay"


def record(scenario: Scenario, folder: Path) -> dict[str, Path]:
    """Run a scenario in this process until it has settled, and write each agent's next messages to a file."""
    team = TeamInProcess(scenario)
    sent: dict[str, deque[tuple[bytes, bytes, bytes]]] = {name: deque(maxlen=BLOCKS) for name in team.graph}
    for _ in range(round(SETTLED / scenario.block_duration) + BLOCKS):
        for name, outbox in team.answer(measured(team.measure()), team.received()).items():
            estimate = b"" if outbox.estimate is None else encode(outbox.estimate, _KEY)
            sent[name].append((encode(outbox.message, _KEY), encode(outbox.reference, _KEY), estimate))
    files = {name: folder / f"{name}.replay" for name in sent}
    for name, path in files.items():
        path.write_bytes(msgspec.msgpack.encode(list(sent[name])))
    return files


def sizes(path: Path) -> tuple[int, int]:
    """Return the median sizes of an agent's messages to its neighbours and of its references [B]."""
    sent = _load(path)
    message, reference = (round(statistics.median(len(each[k]) for each in sent)) for k in (0, 1))
    return message, reference


def read(path: Path) -> list[tuple[NeighbourMessage, Reference, Estimate | None]]:
    """Read what an agent sent after each block."""
    return [
        (
            decode(message, NeighbourMessage, _KEY),
            decode(reference, Reference, _KEY),
            decode(estimate, Estimate, _KEY) if estimate else None,
        )
        for message, reference, estimate in _load(path)
    ]


def _load(path: Path) -> list[tuple[bytes, bytes, bytes]]:
    return msgspec.msgpack.decode(path.read_bytes(), type=list[tuple[bytes, bytes, bytes]])
