"""Which shots are the frames of one burst, and in which order."""

from collections.abc import Sequence
from pathlib import Path

from shared.errors import InputError
from shared.series import frame_number
from tools.host.folders import Source
from tools.host.jobs import identity

_NAMED = 4  # series that an error names, before it counts the others


def series(sources: Sequence[Source]) -> list[str]:
    """The names of the shots of one burst, in its order.

    sources: see `tools.host.folders.search`. Files that the user named are taken as they are, in the order given. Those found in
        a folder have to be the frames of one burst, named as `capture --burst` and `simulate --burst` do, STEM-1.dng, STEM-2.dng
        ...; some may be missing.
    Raises InputError that names the odd ones, for shots in a folder that belong to several bursts or to none, and for a file that
    is given twice, under whatever names.

    >>> series([Source("shots/rose-2.dng", Path("rose-2.dng")), Source("shots/rose-1.dng", Path("rose-1.dng"))])
    ['shots/rose-1.dng', 'shots/rose-2.dng']
    """
    named = [source.name for source in sources if not source.found]
    bursts: dict[Path, list[tuple[int, str]]] = {}
    singles: list[str] = []
    for path in [Path(source.name) for source in sources if source.found]:
        if frame := frame_number(path.stem):
            bursts.setdefault(path.with_name(frame[0]), []).append((frame[1], str(path)))
        else:
            singles.append(str(path))
    found = [[name for _, name in sorted(frames)] for frames in bursts.values()]
    if len(found) > 1 or singles:
        groups = [names[0] + (f" and {len(names) - 1} more" if len(names) > 1 else "") for names in found] + singles
        listed = ", ".join(groups[:_NAMED]) + (f" and {len(groups) - _NAMED} others" if len(groups) > _NAMED else "")
        raise InputError(f"expected the frames of one burst, STEM-1.dng, STEM-2.dng ..., found {listed}; name the files of one")
    names = named + [name for frames in found for name in frames]
    known: dict[object, str] = {}
    for name in names:
        place = identity(name) or name  # other spellings of a name, and links, lead to the same file
        if place in known:
            raise InputError(
                f"{name}: is given twice" + (f": it is the same file as {known[place]}" if known[place] != name else "")
            )
        known[place] = name
    return names


def series_stem(names: Sequence[str]) -> str:
    """What the picture of a burst is called, without suffix: what its frames have in common, or else the first file's stem.

    names: of its shots, see `series`.

    >>> series_stem(["shots/rose-1.dng", "shots/rose-2.dng"]), series_stem(["IMG_0001.dng", "IMG_0002.dng"])
    ('rose', 'IMG_0001')
    """
    stems = [Path(name).stem for name in names]
    common = {frame[0] if (frame := frame_number(stem)) else "" for stem in stems}
    return common.pop() or stems[0] if len(common) == 1 else stems[0]
