"""Errors of decoding libraries, and of the system, as an InputError that says what to do."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ...shared.errors import InputError, is_program_fault

_LARGE = "the picture does not fit into memory; cut or reduce it"


@contextmanager
def readable() -> Iterator[None]:
    """Raise InputError in a `with` block that reads a file which the system cannot read, or which
    does not fit into memory.
    """
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror or error})") from error
    except MemoryError as error:
        raise InputError(_LARGE) from error


@contextmanager
def guarded(path: Path | str = "") -> Iterator[None]:
    """Raise InputError for whatever a library raises in a `with` block that decodes the file: on
    damaged files that is nearly everything.

    The block calls no function of Panchroma: a fault of the program is no damage of the file.
    """
    try:
        yield
    except MemoryError as error:
        raise InputError(_LARGE) from error
    except Exception as error:
        if is_program_fault(error):
            raise
        message = error.args[0] if error.args else ""
        text = message.decode("ascii", "replace") if isinstance(message, bytes) else str(error)
        reason = (text.strip().splitlines() or [type(error).__name__])[0]
        # whoever shows the error names the file
        reason = re.sub(r"<_io.*?>", "", reason.replace(f"'{path}'", "")).strip()
        why = "the file is cut short or damaged; copy it again"
        raise InputError(f"cannot be decoded ({reason}): {why}") from error
