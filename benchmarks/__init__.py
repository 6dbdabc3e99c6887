"""What takes long, or depends on the machine: measurements that are no tests."""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when numpy is loaded: as in the processes that are measured
