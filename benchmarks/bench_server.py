"""The physics server's process with times of each robot's link, optionally without physics.

``python -m benchmarks.bench_server`` reads a ``ServerConfig`` from stdin. The scenario's settings under ``SETTINGS``
name the folder for the times, and whether there is physics.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from msgspec.structs import replace

from coheft.errors import LoadError
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server import server
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.config import ServerConfig
from coheft.wire.messages.structs import Measurements, Message, Reference
from coheft.wire.messages.truth import LoadState
from coheft.wire.process.supervised import supervised_main
from coheft.wire.scenario.schema import Scenario
from coheft.wire.transport.robot_link import RobotLink

SETTINGS = "benchmark"


class TimedLink(RobotLink):
    """Records the times of each block's measurements and answer, and writes them at the end."""

    folder = Path()

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._sent_at: list[tuple[int, float]] = []
        self._answered_at: dict[int, float] = {}

    def send_measurements(self, measurements: Measurements, estimator: str = "") -> None:
        """See ``RobotLink``."""
        self._sent_at.append((measurements.block, time.monotonic()))
        super().send_measurements(measurements, estimator)

    def take(self, message: Message) -> None:
        """See ``RobotLink``."""
        super().take(message)
        if isinstance(message, Reference):
            self._answered_at[message.answers] = time.monotonic()

    def send_stop(self, reason: str) -> None:
        """See ``RobotLink``."""
        super().send_stop(reason)
        rows = [(block, at, self._answered_at.get(block, np.nan)) for block, at in self._sent_at]
        np.save(self.folder / f"{self.name}.npy", np.array(rows))


class BareSimulation:
    """Repeats the same measurements, with those parts of ``Simulation`` that the server needs."""

    def __init__(self, scenario: Scenario, neighbours: Mapping[str, Sequence[str]] | None = None) -> None:
        simulation = Simulation(scenario, neighbours)
        self.scene = simulation.scene
        self.holders = simulation.holders
        self.slots_free = 0
        self.loads: list[LoadState] = []
        self.block = 0
        self._result = simulation.advance({})

    def advance(self, references: Mapping[str, Reference]) -> BlockResult:
        """Return the same block, with the next number."""
        block, self.block = self.block, self.block + 1
        measurements = {name: replace(each, block=block) for name, each in self._result.measurements.items()}
        return BlockResult(measurements, replace(self._result.truth, block=block))

    def inject(self, mass: float, position: object, size: object) -> None:
        """Refuse, because there is no payload.

        Raises:
            LoadError: Always.
        """
        raise LoadError(f"cannot take {mass:g} kg: this run has no physics")


def latencies(folder: Path, names: Sequence[str]) -> Array:
    """Return rows of (block, latency [s]): time from a block's first measurements to its last answer."""
    tables = [np.load(folder / f"{name}.npy") for name in names]
    rows = min(len(table) for table in tables)
    stacked = np.array([table[:rows] for table in tables])
    return np.column_stack([stacked[0, :, 0], stacked[:, :, 2].max(axis=0) - stacked[:, :, 1].min(axis=0)])


def run(config: ServerConfig) -> None:
    """Run the server of a benchmark."""
    settings = config.scenario.settings[SETTINGS]
    TimedLink.folder = Path(settings["folder"])
    simulation = Simulation if settings["physics"] else BareSimulation
    with patch.multiple(server, RobotLink=TimedLink, Simulation=simulation):
        server.run_server(config)


if __name__ == "__main__":
    supervised_main(ServerConfig, run)
