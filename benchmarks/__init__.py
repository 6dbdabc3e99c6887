"""What takes long, or depends on the machine: measurements that are no tests."""

import os

from coheft.wire.process.supervised import ONE_THREAD

os.environ.update(ONE_THREAD)  # before numpy is loaded, which reads it: as in the processes that are measured
