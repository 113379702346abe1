"""Where a worker process begins: it loads no library before the number of their threads is set, which they read only once."""

import os
import pickle
from multiprocessing.connection import Connection

# The last but one is `shared.processors.THREADS`: to import that would load NumPy.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PANCHROMA_THREADS", "OPENCV_FOR_THREADS_NUM")


def begin(connection: Connection, threads: int, work: bytes) -> None:
    """Work with so many threads, see `processes.serve`. work: pickled, for the module that it is in may load anything."""
    os.environ.update(dict.fromkeys(THREAD_VARIABLES, str(threads)))
    from .processes import serve

    serve(connection, pickle.loads(work))
