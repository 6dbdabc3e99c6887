"""A driver for your own robots, in place of the physics server. In this example a recording replaces the robots:

    coheft run ring3 --duration 10 --save-data run.npz     # or a recording of your own, see docs/data-format.md
    coheft run ring3 --write-configs team                  # the agents' configurations
    coheft agent team/r1.json & coheft agent team/r2.json & coheft agent team/r3.json &
    python examples/own_driver.py run.npz team/r1.json team/r2.json team/r3.json

Real robots each have a driver with one configuration, usually on a computer of their own. Block k begins at the same
time for all of them, so clocks have to agree within a fraction of a millisecond.
"""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

import msgspec
import numpy as np

from coheft.errors import CoheftError
from coheft.estimation.geometry.spatial import Array
from coheft.wire.config import AgentProcessConfig
from coheft.wire.data.file import read_recording
from coheft.wire.messages.structs import Estimate
from coheft.wire.transport.driver import open_driver
from coheft.wire.transport.inbox import Inbox, Received
from coheft.wire.transport.sessions import Keys, open_session


def measured(data: Path, configs: list[AgentProcessConfig]) -> dict[str, Array]:
    """Return all samples of each robot, shape (n, 15), in its grasp frame. Read your sensors here instead."""
    recording = read_recording(data)
    rate, names = configs[0].agent.rate, [config.agent.name for config in configs]
    if abs(recording.rate - rate) > 1e-3 * rate or not set(names) <= set(recording.names):
        found = f"{', '.join(recording.names)} at {recording.rate:g} samples a second"
        raise CoheftError(f"{data}: found {found}, but the agents expect {', '.join(names)} at {rate}")
    channels = [recording.stacked(channel) for channel in ("twist", "acceleration", "wrench")]
    return dict(zip(recording.names, np.concatenate(channels, axis=2), strict=True))


def main(data: str, *files: str) -> None:
    """Feed the agents with these configurations, and print their last estimates."""
    configs = [msgspec.json.decode(Path(file).read_bytes(), type=AgentProcessConfig) for file in files]
    samples = measured(Path(data), configs)
    with ExitStack() as stack:
        drivers = [stack.enter_context(open_driver(config)) for config in configs]
        # Only to print the estimates, which agents send to observers.
        watcher, estimates = stack.enter_context(open_session(connect=[config.observe for config in configs])), Inbox()
        for config in configs:
            key = Keys(config.run).observe_agent(config.agent.name, "estimate")
            estimates.listen(watcher, config.agent.name, {key: Estimate})
        for driver in drivers:
            driver.wait_for_agent()
        length = drivers[0].samples
        for block in range(len(samples[drivers[0].name]) // length):
            for driver in drivers:
                driver.reference(block)  # the reference for your arm; a recording cannot follow it
                driver.send(block, samples[driver.name][block * length : (block + 1) * length])
        for driver in drivers:
            driver.finish()
        for driver in drivers:
            driver.stop("the recording is over")
        latest: dict[str, Estimate] = {}
        while isinstance(event := estimates.receive(1.0), Received) and isinstance(event.message, Estimate):
            latest[event.source] = event.message
        for name, told in sorted(latest.items()):
            mass = "not known" if told.payload is None else f"{told.payload.mass:.3f} kg"
            print(f"{name} at {told.time:.1f} s: {told.status}, mass {mass}")


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit("usage: python own_driver.py recording.npz agent.json ...")
    try:
        main(*sys.argv[1:])
    except CoheftError as error:
        sys.exit(f"own_driver: {error}")
    except KeyboardInterrupt:
        sys.exit("stopped")
