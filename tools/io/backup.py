"""Copies of files that are about to be replaced."""

import os
import shutil
from itertools import chain, count
from pathlib import Path

from ...shared.errors import OutputError
from ...shared.writing import durable_file


def keep_old(path: Path) -> Path:
    """Copy a file before it is replaced, and return the name of the copy.

    It is the first free one of NAME.bak, NAME.bak2, ...: no earlier copy is ever replaced.

    Raises OutputError.
    """
    names = (path.with_name(f"{path.name}.bak{number}") for number in chain([""], count(2)))
    spare = next(name for name in names if not os.path.lexists(name))
    try:
        with path.open("rb") as old, durable_file(spare) as copy:
            shutil.copyfileobj(old, copy)
        shutil.copystat(path, spare)
    except OutputError:
        raise
    except OSError as error:
        reason = f"cannot be kept as {spare.name} ({error.strerror or error})"
        raise OutputError(f"{path}: {reason}") from error
    return spare
