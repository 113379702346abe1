"""onnxruntime without telemetry. Every module of ours imports it from here.

Since 1.29 the official packages for Linux and macOS send facts about machine and model to
Microsoft, and keep a database of them and an identity in the user's cache folder. The import begins
with it, so that `disable_telemetry_events` alone comes too late; the variable of the environment is
read by the import alone, and is the program's own again afterwards.
"""

import re
from pathlib import Path
from typing import Any

from .environment import environment
from .errors import InputError

with environment("ORT_DISABLE_TELEMETRY", "1"):
    import onnxruntime

onnxruntime.disable_telemetry_events()

__all__ = ["onnxruntime", "session"]


def session(model: Path | bytes, *, as_written: bool = False, keeps_memory: bool = True) -> Any:
    """An onnxruntime session, which computes in the calling thread; any number of threads may call
    it.

    Raises InputError, which does not name the file, when onnxruntime cannot run it; MemoryError.

    Parameters
    ----------
    model : Path | bytes
        An ONNX file of ours, or its bytes.
    as_written : bool, optional
        Run the nodes in the order of the file as far as possible, not in the one that onnxruntime
        chooses.
    keeps_memory : bool, optional
        Keep what a run took for the next one.
    """
    options = onnxruntime.SessionOptions()
    # our chunks run in parallel instead
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    options.enable_cpu_mem_arena = keeps_memory
    if as_written:
        options.execution_order = onnxruntime.ExecutionOrder.PRIORITY_BASED
    options.log_severity_level = 4  # errors are raised anyway
    try:
        return onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    # each error code of onnxruntime has its own class, without a common base
    except Exception as error:
        if re.search("bad.alloc|allocate memory", str(error)):
            raise MemoryError(str(error)) from error
        raise InputError(f"is not a network that onnxruntime can run ({error})") from error
