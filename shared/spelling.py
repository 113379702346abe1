"""The known word that a user probably meant by a misspelt one."""

from collections.abc import Iterable
from difflib import get_close_matches

_BEGINNING = 3  # letters that may stand for a word
_CLOSE = 0.6  # of 1, by difflib: "bset" and "best" have 0.75


def meant(word: str, known: Iterable[str]) -> str:
    """The end of a message: "; did you mean X?" for the known word that begins with `word`, or else
    resembles it most; "" if none does. Capitals do not count.

    Examples
    --------
    >>> from panchroma.shared.spelling import meant
    >>> meant("Kodk", ("kodak", "sony")), meant("canon", ("kodak", "sony"))
    ('; did you mean kodak?', '')
    """
    names, word = {name.casefold(): name for name in known}, word.casefold()
    begun = [name for name in names if len(word) >= _BEGINNING and name.startswith(word)]
    close = begun if len(begun) == 1 else get_close_matches(word, names, 1, _CLOSE)
    return f"; did you mean {names[close[0]]}?" if close else ""
