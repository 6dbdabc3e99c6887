"""What the tests of the physics share: scenarios changed in a few keys, and robots that move them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec
import numpy as np

from coheft.agents.motion.reference import Excitation
from coheft.estimation.geometry.spatial import Array
from coheft.physics_server.simulation import BlockResult, Simulation
from coheft.wire.messages.structs import Reference
from coheft.wire.scenario.file import load_scenario
from coheft.wire.scenario.motion import draw_waves
from coheft.wire.scenario.schema import Scenario

References = Callable[[int], Mapping[str, Reference]]


def scenario(
    name: str = "ring3", *, noise_scale: float = 0.0, rate: int = 1000, block: int = 5, **keys: object
) -> Scenario:
    """A shipped scenario, with exact sensors and no load changes unless told otherwise."""
    shipped = load_scenario(name)
    sensors = msgspec.structs.replace(shipped.sensors, rate=rate, block=block, noise_scale=noise_scale)
    return msgspec.structs.replace(shipped, **{"sensors": sensors, "load_changes": (), **keys})


def excitation(scenario: Scenario, *, feed_forward: bool = False) -> References:
    """The robots' own choice of motion, from full amplitude on; with a constant feed-forward wrench each if asked."""
    motion = msgspec.structs.replace(scenario.motion, ramp=0.0)
    names = scenario.robot_names
    sensors = scenario.sensors
    waves = [draw_waves(motion.frequency, 1000 + i) for i in range(len(names))]
    motions = [Excitation(motion, each, sensors.rate, sensors.block) for each in waves]
    wrenches = np.random.default_rng(5).normal(size=(len(names), 6)) * [20, 20, 20, 2, 2, 2] * feed_forward

    def references(block: int) -> Mapping[str, Reference]:
        return {
            name: reference(name, block, motion.reference(block), wrench)
            for name, motion, wrench in zip(names, motions, wrenches, strict=True)
        }

    return references


def reference(robot: str, block: int, motion: Array, wrench: Array | None = None) -> Reference:
    """A robot's reference for a block."""
    wrench = np.zeros(6) if wrench is None else wrench
    return Reference(robot=robot, block=block, answers=block - 1, motion=motion, wrench=wrench)


def run(simulation: Simulation, references: References, blocks: int) -> list[BlockResult]:
    """Advance by some blocks."""
    return [simulation.advance(references(simulation.block)) for _ in range(blocks)]


def samples(results: list[BlockResult]) -> Array:
    """All measurements in order of time, shape (N, samples, 15)."""
    names = results[0].measurements
    return np.array([np.concatenate([result.measurements[name].samples for result in results]) for name in names])
