"""Measurements that take long or depend on the machine."""

import os

from coheft.wire.process.supervised import ONE_THREAD

os.environ.update(ONE_THREAD)  # before numpy is loaded, which reads it: as in the processes that are measured
