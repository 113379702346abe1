"""The exceptions of Panchroma, and when to raise which.

``InputError``        what came in cannot be used: a file, an array, a setting. Say what came, what was expected, and the remedy.
                      (``ForeignFileError``: a file, whole as far as one can tell, that is simply not one of ours.)
``OutputError``       what should go out cannot be written: it exists, the folder is missing, the disk is full.
``ConvergenceError``  an iterative solver stopped short of its tolerance: the result would be wrong, so there is none.

Library code raises them without knowing file names it was not given; `tools.cli` alone catches them and prints one line.
"""


class PanchromaError(Exception):
    """Base of every error that Panchroma raises on purpose."""


class InputError(PanchromaError):
    """What came in cannot be used; the message says what was expected."""


class ForeignFileError(InputError):
    """A whole file, but none of ours: what goes through a folder leaves it alone."""


class OutputError(PanchromaError):
    """A result cannot be written; nothing was left half-written."""


class ConvergenceError(PanchromaError):
    """A solver did not reach its tolerance; the message gives iterations and residual."""
