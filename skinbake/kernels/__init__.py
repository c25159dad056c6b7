"""What compiled loops are built of."""

from skinbake.kernels.threads import thread_count

thread_count()  # a number of threads that cannot be is told here: numba, imported next, would fall over it
