"""A router of ROS 2 in the test's own process, and the keys of topics as rmw_zenoh has them, written by hand."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import zenoh

from .team import LIMIT, ROOT

INERTIA = (
    "geometry_msgs::msg::dds_::InertiaStamped_/RIHS01_766be45976252babf7f9d8ac4ae7c912a7ceccf71035622529f27518b695aa09"
)
WRENCH = (
    "geometry_msgs::msg::dds_::WrenchStamped_/RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"
)
TWIST = (
    "geometry_msgs::msg::dds_::TwistStamped_/RIHS01_5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64"
)
ACCEL = (
    "geometry_msgs::msg::dds_::AccelStamped_/RIHS01_ef1df9eabae0a708cc049a061ebcddc4e2a5f745730100ba680e086a9698b165"
)


@contextmanager
def router(port: int) -> Iterator[zenoh.Session]:
    """What 'ros2 run rmw_zenoh_cpp rmw_zenohd' starts, as far as it matters here."""
    settings = {
        "mode": "router",
        "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        "scouting": {"multicast": {"enabled": False}},
    }
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        yield session


def tokens(session: zenoh.Session) -> list[str]:
    """What nodes show of themselves."""
    replies = session.liveliness().get("@ros2_lv/0/**", timeout=LIMIT)
    return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]


@dataclass
class Command:
    """A command that runs, whose output goes to a file."""

    process: subprocess.Popen[bytes]
    output: Path

    def said(self) -> str:
        return self.output.read_text()

    def lines(self) -> list[str]:
        """Whole lines only."""
        return [line for line in self.said().splitlines(keepends=True) if line.endswith("\n")]

    def interrupt(self) -> int:
        """Press Ctrl-C; its exit status."""
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(LIMIT)


@contextmanager
def started(arguments: Sequence[str | Path], output: Path, **environment: str) -> Iterator[Command]:
    """A Python command; none is left at the end."""
    with output.open("ab") as file:  # threads and processes that write to it do not overwrite each other
        process = subprocess.Popen(
            [sys.executable, *map(str, arguments)],
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONUNBUFFERED": "1", **environment},
        )
    try:
        yield Command(process, output)
    finally:
        process.kill()
        process.wait()
