"""What connects the parts: scenarios, stations, networks, episodes and the command line."""

import os

# The filters' matrices are small: a second thread of the linear algebra only gets in the way. It
# has to be said before NumPy is imported.
os.environ.setdefault("OMP_NUM_THREADS", "1")
