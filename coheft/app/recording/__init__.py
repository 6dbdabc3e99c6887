"""Recordings of whole runs: MCAP files of ROS 2 messages, with the run's own messages for an exact replay.

Needs the packages of the extra ``record``; without them this import raises ``MissingPackageError``.
"""

from coheft.errors import require_packages

require_packages("record", "mcap", "rosbags", "zstandard")
