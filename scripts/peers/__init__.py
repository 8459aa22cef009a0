"""What the benchmarks are made of: peers that solve the same problems, timing, profiles, tables.

Imported before NumPy: all contestants run on one thread.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"
