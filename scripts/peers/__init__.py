"""What the planner is measured against: the same problems, solved by other means.

Imported before NumPy: all contestants run on one thread.
"""

import os

for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"
