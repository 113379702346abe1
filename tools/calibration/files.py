"""The files of one calibration, sorted by kind, and the file to be written."""

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from types import MappingProxyType

from shared.errors import InputError, OutputError
from tools.host.folders import DNGS, Search, search
from tools.host.jobs import identity

Files = dict[str, list[str]]
"""The files to calibrate from: paths of each of `KINDS`, then of the charts under each of two lights, by its name."""
KINDS = "shots", "dark", "flat", "edges"


def sort_files(
    sources: Sequence[str],
    dark: Sequence[str],
    flat: Sequence[str],
    edges: Sequence[str],
    lights: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> tuple[Files, list[Search]]:
    """Sort the given files by kind; returns also what was found and left out in folders.

    sources: shots, and folders with DNGs in them or below. Of these, what is named dark*, flat* or edges*, or lies in a subfolder
        of such a name, is a dark or a flat frame or a shot with edges; the others are shots.
    dark, flat, edges: further dark and flat frames and shots with edges, and folders of them.
    lights: charts under each of two lights, and folders of them.

    Raises InputError for a folder that cannot be read or has no DNG, and for a shot under neither light.
    """
    files: Files = {kind: [] for kind in (*KINDS, *lights)}
    searches = []
    for given, known in zip((sources, dark, flat, edges, *lights.values()), files, strict=True):
        found = search(given, DNGS)
        for folder, what in found.failures:
            raise InputError(f"{folder}: {what}")
        searches.append(found)
        for source in found.sources:
            names = [part.lower() for part in reversed(source.below.parts)] if source.below and known == "shots" else []
            kinds = (kind for name in names for kind in ("dark", "flat", "edges") if name.startswith(kind))
            files[next(kinds, known)].append(source.name)
    if lights and files["shots"]:
        raise InputError(f"{files['shots'][0]}: shows a chart under neither light; name it after one of the two `chart_light`")
    return files, searches


def check_output(output: Path, files: Files, *, replace_existing: bool) -> None:
    """Raise OutputError if the camera file cannot be written to `output`. Call it before the measurements."""
    if output.is_dir():
        raise OutputError(f"{output}: is a folder; `output` names the camera file, for example {output / 'camera.json'}")
    if not output.parent.is_dir():
        raise OutputError(f"{output}: the folder {output.parent} does not exist; create it first")
    if output.exists() and identity(output) in map(identity, chain(*files.values())):
        raise OutputError(f"{output}: is an input; choose another name")
    if output.exists() and not replace_existing:
        raise OutputError(f"{output}: exists already; `update` puts the new parts into it, `overwrite` replaces it")
