"""Estimators for your own measurements, without simulation, network or other processes."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from coheft.agents.linked import LinkedAgents
from coheft.consensus.graph import build_graph
from coheft.errors import UsageError
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import SAMPLE_SIZE, MeasurementBlock
from coheft.wire.config import AgentConfig
from coheft.wire.data.file import read_recording, recording_of
from coheft.wire.messages.structs import Estimate
from coheft.wire.scenario.errors import explain
from coheft.wire.scenario.estimator_settings import Converged, EfficientSettings, Fan2017Settings
from coheft.wire.scenario.motion import Motion, draw_waves
from coheft.wire.scenario.robot_sensors import other_sensors_complaints
from coheft.wire.scenario.schema import Graph, GraphKind, Sensors

__all__ = ["Estimate", "Sensors", "Team", "samples_of"]


class Team:
    """A team of agents in this process, one per robot, that identify the load from samples.

    Samples are numbers in the robot's own grasp frame, 15 each: angular velocity [rad/s], velocity of the frame's
    origin [m/s], proper acceleration of it, as accelerometers read it [m/s²], force [N] and torque about the origin
    [N·m] on the payload. Recordings have the moment before the force: ``samples_of`` converts them. Forces have to
    include the payload's weight, because gravity is part of a proper acceleration.

    Args:
        robots: Names of the robots, at least two.
        sensors: The sensors: ``Sensors``, or a dictionary with keys of the scenario's section ``[sensors]``, for
            instance ``{"rate": 500, "noise": {"force": 0.5}, "tolerance": {}}``.
        graph: Links between the robots; any graph works in one process.
        estimator: ``efficient``, ``fan2017``, or one of your own.
        converged: Standard deviations below which an estimate has converged.

    Attributes:
        estimates: The latest estimate of each robot, by name; robots without one are left out.

    Raises:
        UsageError: An argument is invalid.
        PluginError: Your own estimator cannot be used.
    """

    def __init__(
        self,
        robots: Sequence[str],
        *,
        sensors: Sensors | Mapping[str, Any] | None = None,
        graph: GraphKind = "ring",
        estimator: str = "efficient",
        converged: Converged | None = None,
    ) -> None:
        names = tuple(robots)
        if isinstance(robots, str) or len(set(names)) != len(names) or len(names) < 2:
            raise UsageError(f"robots: found {robots!r}, expected at least two different names")
        told = _checked(sensors, names)
        self.estimates: dict[str, Estimate] = {}
        self._block_size = told.block
        self._index = 0
        self._waiting: dict[str, Array] = {name: np.empty((0, SAMPLE_SIZE)) for name in names}
        motion = Motion()
        noise = told.noise.scaled(told.noise_scale)
        self._agents = LinkedAgents(
            AgentConfig(
                name=name,
                neighbours=others,
                noise=noise,
                noise_correlation=told.noise_correlation,
                tolerance=told.tolerance,
                drift=told.drift,
                rate=told.rate,
                block=told.block,
                lag=1,
                seed=0,
                motion=motion,
                waves=draw_waves(motion.frequency, 0),  # not used, as there are no arms to move
                estimator=estimator,
                fan2017=Fan2017Settings(),
                efficient=EfficientSettings(),
                estimator_settings={},
                motion_settings={},
                converged=converged or Converged(),
                unequal=told.unequal(),
            )
            for name, others in build_graph(Graph(kind=graph), names).items()
        )

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots' names."""
        return tuple(self._waiting)

    def add(self, samples: Mapping[str, npt.ArrayLike]) -> None:
        """Process the next samples of all robots, taken at the same times.

        Any number is allowed. Estimates are updated whenever a block is full (``sensors.block``).

        Args:
            samples: Samples by robot, shape (n, 15) or (15,), with the same n for all. Rows of NaN mark missing
                measurements: their block is left out for this robot.

        Raises:
            UsageError: A robot is missing or not in the team, or shapes do not match.
        """
        arrays = {name: np.atleast_2d(np.asarray(values, dtype=np.float64)) for name, values in samples.items()}
        if set(arrays) != set(self._waiting):
            raise UsageError(f"samples: found robots {', '.join(arrays)}, expected {', '.join(self._waiting)}")
        shapes = {name: array.shape for name, array in arrays.items()}
        count = max(shape[0] for shape in shapes.values())
        wrong = [f"{name} {shape}" for name, shape in shapes.items() if shape != (count, SAMPLE_SIZE)]
        if wrong:
            raise UsageError(f"samples: found shape of {', '.join(wrong)}, expected {(count, SAMPLE_SIZE)} for each")
        for name, array in arrays.items():
            self._waiting[name] = np.concatenate([self._waiting[name], array])
        whole = len(next(iter(self._waiting.values()))) // self._block_size
        for number in range(whole):
            self._step(slice(number * self._block_size, (number + 1) * self._block_size))
        self._waiting = {name: array[whole * self._block_size :] for name, array in self._waiting.items()}

    def _step(self, rows: slice) -> None:
        blocks = {name: MeasurementBlock(self._index, array[rows]) for name, array in self._waiting.items()}
        for name, outbox in self._agents.step(self._index, blocks, self._agents.received()).items():
            if outbox.estimate is not None:
                self.estimates[name] = outbox.estimate
        self._index += 1


def samples_of(recording: str | Path | Mapping[str, npt.ArrayLike]) -> dict[str, Array]:
    """Convert a recording, whose wrenches have the moment first, to samples, which have the force first.

    Args:
        recording: Path of an ``.npz`` file or of a folder of CSV files, or arrays named as in an ``.npz`` file, with
            twists, accelerations and wrenches of all robots (docs/data-format.md).

    Returns:
        Samples by robot, shape (n, 15) each, as ``Team.add`` takes them.

    Raises:
        RecordingError: The recording cannot be read, or lacks one of these signals.
    """
    found = recording_of(recording) if isinstance(recording, Mapping) else read_recording(Path(recording))
    channels = [found.stacked(channel) for channel in ("twist", "acceleration", "wrench")]
    return dict(zip(found.names, np.concatenate(channels, axis=2), strict=True))


def _checked(sensors: Sensors | Mapping[str, Any] | None, names: Sequence[str]) -> Sensors:
    """Check the sensors for the types and ranges of a scenario's section, and that they are of robots of the team.

    Raises:
        UsageError: A key or value is not allowed.
    """
    table = msgspec.to_builtins(sensors) if isinstance(sensors, Sensors) else dict(sensors or {})
    try:
        known = msgspec.convert(table, Sensors)
    except msgspec.ValidationError as error:
        raise UsageError(f"sensors: {explain(error, table, Sensors)}") from error
    for key, complaint in other_sensors_complaints(known.of, known.tolerance, names):
        raise UsageError(f"sensors: key '{key}': {complaint}")
    return known
