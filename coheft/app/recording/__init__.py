"""Recordings of whole runs: MCAP files of ROS 2 messages, with the run's own messages for an exact replay.

Needs the packages of the extra ``record``; without them this import raises ``MissingPackageError``.
"""

from importlib.util import find_spec

from coheft.errors import MissingPackageError

for _package in ("mcap", "rosbags", "zstandard"):
    if find_spec(_package) is None:
        raise MissingPackageError(_package, "record")
