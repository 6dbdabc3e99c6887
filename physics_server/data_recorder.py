"""Recording of all robots' measurements for a data file, as an experiment with real robots would produce it."""

import numpy as np

from coheft.estimation.batch.recording import Recording, RobotRecord, Truth
from coheft.estimation.geometry.spatial import Array, Pose
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.estimation.rigid_body.mass_properties import Inertia
from coheft.physics_server.simulation import BlockResult
from coheft.wire.messages.truth import PayloadTruth, Scene
from coheft.wire.scenario.schema import Scenario


class DataRecorder:
    """Collects blocks. Robots with encoders record poses and forces; others twist, acceleration and wrench, as far as
    they measure all of it.

    The torque of robots with encoders is zero, because their gimbals transmit none. Gravity is (0, 0, -9.81) in their
    home frames, which are level: other scenarios are refused.
    """

    def __init__(self, scenario: Scenario, scene: Scene) -> None:
        self._scenario = scenario
        self._scene = scene
        self._samples: list[Array] = []
        self._loads: list[tuple[float, PayloadTruth]] = []

    def add(self, result: BlockResult) -> None:
        """Add the next block of the run."""
        if result.wrists is not None:
            self._samples.append(result.wrists)
        else:
            own = [result.measurements[name].samples for name in self._scene.robots]
            self._samples.append(np.stack(own, axis=1))
        payload = result.truth.payload
        if not self._loads or not _same(self._loads[-1][1], payload):
            self._loads.append((result.truth.time - self._scenario.block_duration, payload))

    def recording(self) -> Recording:
        """Return a recording of all blocks so far."""
        samples = np.concatenate(self._samples)
        time = np.arange(len(samples)) / self._scenario.sensors.rate
        grasps = [Pose(r, p) for r, p in zip(self._scene.rotations, self._scene.translations, strict=True)]
        to_first = grasps[0].inverse()
        with_encoders = self._scenario.sensors.encoders is not None
        robots = {}
        for i, (name, sensors) in enumerate(zip(self._scene.robots, self._scenario.robot_sensors(), strict=True)):
            own = samples[:, i]
            if with_encoders:
                robots[name] = RobotRecord(time, pose=own[:, :7], wrench=own[:, 7:])
            else:
                record = RobotRecord(
                    time, twist=own[:, TWIST], acceleration=own[:, ACCELERATION], wrench=own[:, WRENCH]
                )
                robots[name] = sensors.recorded(record)
        loads = tuple(
            (since, Inertia(load.mass, load.com, load.tensor).transported(to_first)) for since, load in self._loads
        )
        return Recording(
            robots=robots,
            noise=None if with_encoders or self._scenario.sensors.of else self._scenario.noise,
            truth=Truth(tuple(to_first @ grasp for grasp in grasps), loads),
        )


def _same(one: PayloadTruth, other: PayloadTruth) -> bool:
    return one.mass == other.mass and np.array_equal(one.com, other.com) and np.array_equal(one.tensor, other.tensor)
