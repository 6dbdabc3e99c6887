"""Whether measurements can be those of robots that hold one load: units, gravity, and the sign of forces."""

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.batch.judge.sensors import stuck_motion, stuck_sensor
from coheft.estimation.batch.plausibility import check_units, check_weight
from coheft.estimation.batch.recording import Recording, RobotRecord
from coheft.estimation.geometry.spatial import Array
from coheft.estimation.measurement import ACCELERATION, TWIST, WRENCH
from coheft.wire.scenario.robot_sensors import RobotSensors

_KEPT = 2.0
"""Time for which blocks are kept [s]."""
_TURNING, _UNLIKE = 0.1, 0.3
"""Angular velocity that tells robots apart [rad/s], and the share of it by which they differ."""


class Contents:
    """The newest blocks of all robots, of which there are ``rates`` per second by robot."""

    def __init__(self, rates: Mapping[str, float], sensors: Mapping[str, RobotSensors]) -> None:
        self._sensors = sensors
        self._blocks: dict[str, deque[tuple[int, Array]]] = {
            robot: deque(maxlen=max(1, round(_KEPT * rate))) for robot, rate in rates.items()
        }

    def note(self, robot: str, block: int, samples: Array) -> None:
        """Note a block: its number, and samples (B, 15)."""
        self._blocks[robot].append((block, samples))

    def complaint(self, sample_rate: float) -> str:
        """What is impossible in the newest blocks, and what to do; empty if nothing is."""
        full = {robot: blocks for robot, blocks in self._blocks.items() if len(blocks) == blocks.maxlen}
        if not full:
            return ""
        recording = Recording({robot: self._record(robot, sample_rate) for robot in full})
        try:
            check_units(recording)
            numbers = {tuple(number for number, _ in blocks) for blocks in self._blocks.values()}
            is_whole = all(map(recording.has, ("twist", "acceleration", "wrench")))
            if is_whole and len(full) == len(self._blocks) and len(numbers) == 1:
                if stuck := stuck_sensor(recording) or stuck_motion(recording):
                    return (
                        f"{stuck.words.partition(':')[0]}: its sensor does not work, or something repeats its reading"
                    )
                check_weight(recording, recording.stacked("wrench"), recording.stacked("acceleration"))
                return _unlike(recording.names, np.linalg.norm(recording.stacked("twist")[..., :3], axis=-1))
        except RecordingError as error:
            return str(error)
        return ""

    def _record(self, robot: str, rate: float) -> RobotRecord:
        """The newest samples of a robot, without what it does not measure."""
        samples = np.concatenate([own for _, own in self._blocks[robot]])
        columns = {"twist": TWIST, "acceleration": ACCELERATION, "wrench": WRENCH}
        record = RobotRecord(np.arange(len(samples)) / rate, **{name: samples[:, own] for name, own in columns.items()})
        own = self._sensors[robot].recorded(record)
        if self._sensors[robot].is_missing()[WRENCH].all():
            return own
        return replace(own, wrench=record.wrench)  # forces may be measured without moments


def _unlike(names: Sequence[str], speeds: Array) -> str:
    """Find robots whose angular velocity has another size (N, n) than in the middle: one load has only one."""
    middle = np.median(speeds, axis=0)
    size = float(np.sqrt(np.mean(middle**2)))
    off = np.sqrt(np.mean((speeds - middle) ** 2, axis=1))
    if size < _TURNING or off.max() < _UNLIKE * size:
        return ""
    unlike = [name for name, one in zip(names, off, strict=True) if one > 0.5 * off.max()]
    return (
        f"angular velocities of {', '.join(unlike)} are {100.0 * off.max() / size:.0f} % off the others' in size, but "
        f"one load has only one: are they in rad/s, and as angular, not as linear, and clocks alike?"
    )
