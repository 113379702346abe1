"""Names of the frames of a burst: STEM-1, STEM-2, ... with zeros in front, so that they sort by
name.
"""

import re


def frame_name(stem: str, number: int, count: int) -> str:
    """Name of a frame, without the suffix of the file.

    Parameters
    ----------
    stem : str
        What the frames have in common.
    number : int
        Of the frame, 1 to `count`.
    count : int
        Number of frames.

    Examples
    --------
    >>> frame_name("rose", 3, 8), frame_name("rose", 3, 15)
    ('rose-3', 'rose-03')
    """
    return f"{stem}-{number:0{len(str(count))}}"


def frame_number(name: str) -> tuple[str, int] | None:
    """(stem, number) of a frame, from its name without suffix; None if it is no name of a frame.

    Examples
    --------
    >>> frame_number("rose-03")
    ('rose', 3)
    """
    found = re.fullmatch(r"(.+)-(\d+)", name, re.DOTALL)
    return (found[1], int(found[2])) if found else None
