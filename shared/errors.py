"""The exceptions of Panchroma, and when to raise which.

``InputError``, a ValueError
    An input cannot be used: a file, an array, a setting. The message says what came, what was
    expected, and the remedy (``MissingFileError``, a FileNotFoundError too: there is no such file;
    ``ForeignFileError``: an intact file of another kind).
``OutputError``, an OSError
    An output cannot be written: it exists, the folder is missing, the disk is full.
``ConvergenceError``, an ArithmeticError
    An iterative solver did not reach its tolerance: the result would be wrong, so there is none.
``RangeError``, an ArithmeticError
    A result has values that are not finite (NaN or infinite): it would be wrong, so there is none.
``DurabilityWarning``
    A result is complete, but may not survive a power cut: a warning of Python, once per folder.

Library code names a file in a message only if it was given one; the commands print one line per
error. A message may say which known word a user probably meant by a misspelt one (`meant`).
"""

from collections.abc import Iterable
from difflib import get_close_matches


class PanchromaError(Exception):
    """Base class of every error that Panchroma raises on purpose.

    Examples
    --------
    >>> from panchroma.shared import PanchromaError, read_dng
    >>> try:
    ...     read_dng("missing.dng")
    ... except PanchromaError as error:
    ...     print(error)
    missing.dng: there is no such file; check the name
    """


class InputError(PanchromaError, ValueError):
    """An input cannot be used; the message says what was expected.

    Examples
    --------
    >>> from panchroma.shared import CfaPattern, InputError
    >>> try:
    ...     CfaPattern.bayer(period=1)
    ... except InputError as error:
    ...     print(error)
    pattern: the period is 1, expected 3 to 16
    """


class MissingFileError(FileNotFoundError, InputError):
    """There is no file of the name that was given."""


class ForeignFileError(InputError):
    """An intact file of another kind than the one that is wanted; commands that search folders
    leave it out.
    """


class OutputError(PanchromaError, OSError):
    """A result cannot be written; no partial file was left behind.

    Examples
    --------
    >>> from panchroma.shared import OutputError
    >>> issubclass(OutputError, OSError)
    True
    """


class ConvergenceError(PanchromaError, ArithmeticError):
    """A solver did not reach its tolerance; the message states iterations and residual."""


class RangeError(PanchromaError, ArithmeticError):
    """A result has values that are not finite; the message says of what, how many, and where."""


def is_program_fault(error: BaseException) -> bool:
    """Return True for an exception of a kind that no damaged file causes in code of Panchroma: a
    name, attribute or module that does not exist.

    Blocks that turn what a library raises on damaged files into an InputError let it pass. Raised
    by the library itself it may come of the file.
    """
    trace = error.__traceback__
    while trace and trace.tb_next:
        trace = trace.tb_next
    ours = trace is None or trace.tb_frame.f_globals.get("__name__", "").startswith("panchroma.")
    return ours and isinstance(error, NameError | AttributeError | ImportError)


class DurabilityWarning(UserWarning):
    """A file is whole and has its name, but it is unsure whether it has it after a power cut."""


def meant(word: str, known: Iterable[str]) -> str:
    """The end of a message: "; did you mean X?" for the known word that begins with `word`, or else
    resembles it most; "" if none does. Capitals do not count.

    Examples
    --------
    >>> from panchroma.shared.errors import meant
    >>> meant("Kodk", ("kodak", "sony")), meant("canon", ("kodak", "sony"))
    ('; did you mean kodak?', '')
    """
    names, word = {name.casefold(): name for name in known}, word.casefold()
    begun = [name for name in names if len(word) >= 3 and name.startswith(word)]
    # difflib's 0.6 of 1: "bset" and "best" have 0.75
    close = begun if len(begun) == 1 else get_close_matches(word, names, 1)
    return f"; did you mean {names[close[0]]}?" if close else ""
