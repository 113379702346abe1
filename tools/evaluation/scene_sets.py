"""The scenes of an evaluation: which files they are, and which of them may be pooled."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain, count
from pathlib import Path

import numpy as np

from ...shared import FloatArray, InputError
from ...shared.reading import MAX_PIXELS, naming
from ...shared.white_balance import shades_of_grey
from ..batch.folders import search
from ..io.scene import RGB, Scene
from ..simulation.load import ENDINGS, is_drawn, load_scene, set_aside
from .metrics import BORDER, PSNR_PATCH

# Sets in the order of the report. A developed picture (interpolated, sharpened, quantised to 8
# bits) is not a measurement of light: it is linearised, but never pooled with what sensors
# measured.
MEASURED = "linear photographs"
DEVELOPED = "developed pictures"
BUILTIN = "built-in scenes"
_KNOWN = {"Kodak": r"kodim\d\d", "McMaster": r"(mcm|mcmaster)[-_]?\d\d?"}  # names of their files
# pixels: every scene is cut to whole periods of the paper's pattern, whatever periods are compared
CROP = 6
SETS = (MEASURED, "Kodak", "McMaster", DEVELOPED, BUILTIN)
_LEAST_SIDE = (PSNR_PATCH + 2 * BORDER + CROP) // CROP * CROP


@dataclass(frozen=True)
class SceneInfo:
    """A scene that can be read.

    Attributes
    ----------
    source : str
        File, or `builtin:WxH`.
    name : str
        Unique, for tables.
    group : str
        One of SETS.
    digest : str
        Of its pixels, after cutting.
    rows, columns : int
        After cutting.
    neutral : tuple[float, ...] | None
        What white reads, one value per channel; None = unknown.
    notes : tuple[str, ...]
        Remarks for the user on how the file was interpreted.
    """

    source: str
    name: str
    group: str
    digest: str
    rows: int
    columns: int
    neutral: tuple[float, ...] | None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Reading:
    """Options for reading sources.

    Attributes
    ----------
    linear : bool
        The numbers in the pictures are light, whatever the files say.
    largest : int | None
        Longest side, pixels; None = whole scenes.
    channels : str
        Letters of the channels that every scene has.
    max_pixels : int
        Larger files are refused.
    """

    linear: bool = False
    largest: int | None = None
    channels: str = RGB
    max_pixels: int = MAX_PIXELS

    @lru_cache(maxsize=1)  # noqa: B019 (keeps one: methods are measured scene by scene)
    def scene(self, info: SceneInfo) -> Scene:
        """Load a scene and cut it.

        Raises InputError, naming the file, if it cannot be read, or has changed since.
        """
        with naming(info.source):
            scene = _loaded(info.source, self)
            if digest(scene.rgb) != info.digest:
                raise InputError("the picture has changed since the evaluation began; run it again")
        return scene

    def info(self, source: str) -> SceneInfo:
        """Facts about a scene.

        Raises InputError, without the name of the source, if it cannot be read or is too small.
        """
        scene = _loaded(source, self)
        group = MEASURED if self.linear else _group(source, scene)
        facts = (scene.name, group, digest(scene.rgb), *scene.shape, _neutral(scene, group))
        return SceneInfo(source, *facts, scene.notes)


def _loaded(source: str, reading: Reading) -> Scene:
    """Return the scene, cut."""
    needed, most = reading.channels, reading.max_pixels
    scene = load_scene(source, linear=reading.linear, max_pixels=most, channels=needed)
    if scene.channels != needed:
        raise InputError(f"its channels are {scene.channels}, and `pattern` needs {needed}")
    rows, columns = (_kept(size, reading.largest) for size in scene.shape)
    rgb = np.ascontiguousarray(scene.rgb[rows, columns])
    if min(rgb.shape[:2]) < _LEAST_SIDE:
        size = f"{rgb.shape[1]} x {rgb.shape[0]} pixels"
        least = f"{_LEAST_SIDE} each way at least, also of `crop`, for one patch within the border"
        raise InputError(f"{size} are left, too few: {least}")
    return replace(scene, rgb=rgb)


def _kept(size: int, largest: int | None) -> slice:
    """The rows or columns of a scene that are left: whole multiples of CROP, in the middle if there
    is a largest number of them.
    """
    kept = min(size, largest or size) // CROP * CROP
    first = (size - kept) // 2 if largest else 0
    return slice(first, first + kept)


def digest(rgb: FloatArray) -> str:
    """32 hexadecimal digits that identify the shape and the pixels of a scene."""
    total = hashlib.sha256(repr(rgb.shape).encode())
    total.update(np.ascontiguousarray(rgb, "<f4").data)
    return total.hexdigest()[:32]


def expand(sources: Sequence[str], output: Path) -> tuple[list[str], list[str]]:
    """The sources, each folder replaced by the scenes in and below it; and a remark on each folder
    of which a part is left out.

    output: a folder that is not searched. Raises InputError for a folder that cannot be read, or
    has no scene.
    """
    result = search(sources, ENDINGS, output=output, is_file=is_drawn, set_aside=set_aside)
    for folder, fault in result.failures:
        raise InputError(f"{folder}: {fault}")
    return [source.name for source in result.sources], result.left_out


def distinct(scenes: list[SceneInfo]) -> tuple[list[SceneInfo], list[str]]:
    """The scenes, each once and under a unique name; and a remark for the user on each one left
    out.
    """
    kept: dict[str, SceneInfo] = {}
    remarks = []
    for scene in scenes:
        if scene.digest in kept:
            same = f"the same pixels as {kept[scene.digest].source}"
            remarks.append(f"{scene.source}: has {same} and is measured once")
        else:
            taken = [other.name for other in kept.values()]
            names = chain([scene.name], (f"{scene.name} ({number})" for number in count(2)))
            name = next(name for name in names if name not in taken)
            kept[scene.digest] = replace(scene, name=name)
    return list(kept.values()), remarks


def _neutral(scene: Scene, group: str) -> tuple[float, ...] | None:
    """Readings of white, estimated for linear pictures without this information: they claim to be
    balanced and seldom are.
    """
    if group == MEASURED and (scene.neutral is None or len(set(scene.neutral)) == 1):
        return shades_of_grey(scene.rgb) or scene.neutral
    return scene.neutral


def _group(source: str, scene: Scene) -> str:
    if is_drawn(source):
        return BUILTIN
    if not scene.eight_bits:
        return MEASURED
    stem = Path(source).stem.lower()
    return next((name for name, files in _KNOWN.items() if re.fullmatch(files, stem)), DEVELOPED)
