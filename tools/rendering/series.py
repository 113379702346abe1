"""Which shots are the frames of one burst, and in which order."""

from collections.abc import Sequence
from pathlib import Path

from shared.errors import InputError
from shared.series import frame_number
from tools.host.folders import Source

_NAMED = 4  # series that an error names, before it counts the others


def series(sources: Sequence[Source]) -> list[str]:
    """The names of the shots of one burst, in its order.

    sources: see `tools.host.folders.search`. Files that the user named are taken as they are, in the order given. Those found in a
        folder have to be the frames of one burst, named as `capture --burst` and `simulate --burst` do (STEM-1.dng, STEM-2.dng ...);
        frames may be missing.
    Raises InputError that names the odd ones, for shots in a folder that belong to several bursts or to none, and for a file that is
    given twice.

    >>> series([Source("shots/rose-2.dng", Path("rose-2.dng")), Source("shots/rose-1.dng", Path("rose-1.dng"))])
    ['shots/rose-1.dng', 'shots/rose-2.dng']
    """
    bursts: dict[Path, list[tuple[int, str]]] = {}  # path of the stem -> frames; of a shot that is no frame its own
    for source in sources:
        if source.found:
            path = Path(source.name)
            stem, number = frame_number(path.stem) or (path.name, 0)
            bursts.setdefault(path.with_name(stem), []).append((number, source.name))
    frames = {stem: [name for _, name in sorted(found)] for stem, found in bursts.items()}
    if len(frames) > 1 or any(numbered[0][0] == 0 for numbered in map(sorted, bursts.values())):
        found = [names[0] + (f" and {len(names) - 1} more" if len(names) > 1 else "") for names in frames.values()]
        listed = ", ".join(found[:_NAMED]) + (f" and {len(found) - _NAMED} others" if len(found) > _NAMED else "")
        raise InputError(f"expected the frames of one burst, STEM-1.dng, STEM-2.dng ..., found {listed}; name the files of one")
    names = [source.name for source in sources if not source.found] + [name for burst in frames.values() for name in burst]
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise InputError(f"{min(twice)}: is given twice")
    return names
