"""Load a scene: a camera RAW, a picture, or a built-in scene."""

import re
import sys
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from shutil import copyfileobj
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...shared import CodeArray, InputError, read_dng
from ...shared.dng.tags import MAKER, TAG, Photometric
from ...shared.errors import ForeignFileError
from ...shared.reading import MAX_PIXELS, File, file_name, opened_file
from ..io.camera_raw import NO_RAW, camera_raw_samples, camera_raw_scene
from ..io.damage import guarded, readable
from ..io.decoders import EXR, JPEG, NPY, PNG, PictureFormat
from ..io.linear_dng import linear_dng_scene
from ..io.picture import gehler_shi_scene, picture_scene
from ..io.scene import RGB, Scene, check_size, scene_channels
from ..io.tiff import TIFF, opened_tiff
from .drawn.builtin import builtin_scene
from .drawn.charts import chart_scene

# Whether what begins like a TIFF is a picture depends on more than its first bytes.
SCENE_FORMATS = PNG, JPEG, EXR, NPY, TIFF
# Built-in scenes: prefix, and the function that draws them at width x height.
_DRAWN: dict[str, Callable[..., Scene]] = {"builtin:": builtin_scene, "chart:": chart_scene}
# Even ones: prefix, and what each reads everywhere, in all channels. Less light makes flat frames
# that do not clip.
_EVEN = {"flat:": 1.0, "dark:": 0.0}
_END = 16 << 20
# What camera RAWs that are no TIFFs begin with. Some begin with nothing in particular, and are
# known by their names.
_RAW_START = rb"II|MM|FUJIFILM|\0MRM|FOVb|....ftypcrx"
_RAWS = (
    "3fr ari arw bay bmq cap cine cr2 cr3 crw cs1 dc2 dcr dcs dng drf dsc erf fff gpr ia iiq k25 "
    "kc2 kdc mdc mef mos mrw nef nrw orf ori pef ptx pxn qtk raf raw rdc rw2 rwl rwz sr2 srf srw "
    "sti x3f"
)
_RAW_ENDINGS = tuple(f".{name}" for name in _RAWS.split())
# in XMP; and IPTC's keywords (2:25) behind another field or before it
_NOTED = {
    "rating": rb"""Rating(?:=["']|>)[1-5]""",
    "keywords": rb"<dc:subject|\x1c\x02[^\x1c]{2,300}\x1c\x02\x19\0"
    rb"|\x1c\x02\x19\0[^\x1c]{1,66}\x1c\x02",
}
ENDINGS = (*(ending for each in SCENE_FORMATS for ending in each.endings), *_RAW_ENDINGS)
"""Endings of the names of files that may be scenes: what is looked for in folders, but for what
`set_aside` says.
"""
TRUTH, TRUTH_PICTURE = ".truth.tif", ".truth.png"
"""Ends of the names of the truth of a simulated shot, and of its picture to look at, behind the
stem of the shot.
"""


def load_scene(
    source: str,
    *,
    linear: bool = False,
    max_pixels: int = MAX_PIXELS,
    channels: str = RGB,
    registered: bool = True,
) -> Scene:
    """Return the scene in a file, or a built-in scene.

    The content decides which kind a file is, and the name's ending must agree.

    Raises InputError that says what was found and what to do; it does not name the file.

    Parameters
    ----------
    source : str
        One of the path of a Bayer camera RAW (see `camera_raw_scene`), or of a linear DNG (see
        `linear_dng_scene`), the path of a TIFF, PNG, JPEG, EXR or NPY picture (see `picture_scene`:
        8 bits are sRGB, more bits are linear, unless the file says otherwise; Gehler's data set in
        Shi and Funt's version is recognised), "builtin:WxH" (see `builtin_scene`), "chart:WxH" (see
        `chart_scene`), "flat:WxH", "dark:WxH" (evenly lit white at full scale, no light: to
        calibrate with).
    linear : bool, optional
        Take the values of any picture as linear light.
    max_pixels : int, optional
        Larger scenes are refused.
    channels : str, optional
        Those of the pattern that will see the scene. An EXR has them by their names, a TIFF or NPY
        in their order, if it has as many; otherwise, and in all other files, the scene has red,
        green and blue.
    registered : bool, optional
        Of camera RAWs, see `camera_raw_scene`.
    """
    if is_drawn(source):
        return _draw(source, max_pixels, channels)
    path = Path(source)
    picture_format, is_dng = file_kind(path)
    notes = _remark_on_losses(path)
    if picture_format:
        with readable():
            picture = picture_format.decode(path, max_pixels, channels)
        gehlers = gehler_shi_scene(picture, path.stem) if picture_format.name == "PNG" else None
        scene = gehlers or picture_scene(picture, path.stem, linear=linear)
    else:
        with readable():
            linear_scene, remarks = linear_dng_scene(path, max_pixels) if is_dng else (None, ())
            scene = linear_scene or camera_raw_scene(path, max_pixels, registered=registered)
            notes += remarks
    return replace(scene, notes=(*scene.notes, *notes)) if notes else scene


@contextmanager
def named_file(file: File) -> Iterator[str]:
    """The name of the file of a scene. What is in a file object goes into a temporary file, for the
    time of a `with` block: decoders read at several places, some in processes of their own.

    Raises InputError, which does not name the file, as `opened_file` does.
    """
    if isinstance(file, str | PathLike):
        yield file_name(file)
        return
    with opened_file(file, sys.maxsize, "a picture or a camera RAW") as stream:
        start = stream.read(16)
        kinds = (kind for kind in SCENE_FORMATS if re.match(kind.start, start, re.DOTALL))
        ending = next((kind.endings[0] for kind in kinds), "")
        name = Path(file_name(file)).name
        with TemporaryDirectory() as folder:
            path = Path(folder, name if Path(name).suffix else f"picture{ending}")
            stream.seek(0)
            with path.open("wb") as copy:
                copyfileobj(stream, copy)
            yield str(path)


def sensor_samples(path: Path, max_pixels: int = MAX_PIXELS) -> CodeArray:
    """Read the samples in a shot of Panchroma, in another camera's RAW or DNG, or in a grey TIFF,
    PNG or NPY: uint16 (H, W).

    Raises InputError, which does not name the file, for any other file.

    max_pixels: larger files are refused.
    """
    try:
        picture_format, _ = file_kind(path)
    except ForeignFileError:
        return read_dng(path, max_pixels=max_pixels).codes
    with readable():
        if picture_format is None:
            return camera_raw_samples(path, max_pixels)
        pixels = picture_format.decode(path, max_pixels, RGB).pixels
    if pixels.shape[2] != 1:
        remedy = "give the samples of the sensor, one at each pixel"
        raise InputError(f"is a picture with several colours at each pixel; {remedy}")
    if pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        expected = "those of a sensor are whole numbers of 8 or 16 bits"
        raise InputError(f"its samples are {pixels.dtype}; {expected}")
    return pixels[..., 0].astype(np.uint16)


def file_kind(path: Path) -> tuple[PictureFormat | None, bool]:
    """The format of a picture, by its content, None for a file that may be a camera RAW; and
    whether that is a DNG, or another TIFF with a mosaic.

    Raises ForeignFileError for a shot of Panchroma. Raises InputError for a file that can be
    neither.
    """
    with opened_file(path, sys.maxsize, "a picture or a camera RAW") as file:
        start = file.read(16)
    suffix = path.suffix.lower()
    kinds = (kind for kind in SCENE_FORMATS if re.match(kind.start, start, re.DOTALL))
    kind, is_dng = next(kinds, None), False
    if kind is TIFF:
        is_shot, is_dng = _inspect_tiff(path)
        if is_shot:
            fault = "this is a shot, sampled by the sparse-colour sensor already, and no scene"
            raise ForeignFileError(f"{fault}; render it")
    elif kind and suffix not in kind.endings:
        remedy = f"if that is right, rename it {path.stem}{kind.endings[0]}"
        raise InputError(f"is a {kind.name} picture by its content; {remedy}")
    is_picture = kind is not None and suffix in kind.endings and not is_dng
    is_text = str(path) == str(path).encode(errors="ignore").decode()
    if not is_text and (suffix == ".exr" or not is_picture):  # LibRaw and OpenEXR take text alone
        raise InputError("its name is no text in UTF-8; rename it")
    if is_picture:
        return kind, False
    if not (suffix in ENDINGS or re.match(_RAW_START, start, re.DOTALL)):
        raise InputError(NO_RAW.format("by its name and its first bytes"))
    return None, is_dng


def set_aside(paths: Sequence[str]) -> dict[str, str]:
    """Return which files in one folder are no scenes of their own, and why: pictures beside a
    camera RAW of their name, results.

    paths: files with `ENDINGS`.
    """
    truths = [path for path in paths if path.lower().endswith((TRUTH, TRUTH_PICTURE))]
    aside = dict.fromkeys(truths, "(the truth of a shot)")
    alike = defaultdict[str, list[str]](list)
    for path in paths:
        alike[Path(path).stem.lower()].append(path)
    for names in alike.values():
        if len(names) > 1:
            raws = [path for path in names if path.lower().endswith(_RAW_ENDINGS)]
            shots = [path for path in raws if _is_shot(path)]
            aside |= dict.fromkeys(shots, "(a shot of Panchroma, no scene)")
            if len(raws) > len(shots):
                others = (path for path in names if path not in raws)
                aside |= dict.fromkeys(others, "beside a camera RAW of the same name")
    return aside


def _is_shot(path: str) -> bool:
    try:
        file_kind(Path(path))
    except InputError as error:
        return isinstance(error, ForeignFileError)
    return False


def is_drawn(source: str) -> bool:
    """Return whether a SCENE is a built-in scene, not a file."""
    return source.startswith((*_DRAWN, *_EVEN))


def _draw(source: str, max_pixels: int, channels: str) -> Scene:
    kind = source[: source.index(":") + 1]
    size = re.fullmatch(r"(\d{1,6})x(\d{1,6})", source.removeprefix(kind))
    if not size:
        form = f"{kind}WIDTHxHEIGHT, for example {kind}1200x800"
        raise InputError(f"is not a built-in scene; write {form}")
    width, height = int(size[1]), int(size[2])
    check_size(width, height, max_pixels=max_pixels)
    if kind in _DRAWN:
        return _DRAWN[kind](width, height)
    there = scene_channels(channels)
    there = RGB if set(there) <= set(RGB) else there
    light = np.full((height, width, len(there)), _EVEN[kind], np.float32)
    return Scene(light, f"{kind[:-1]}-{width}x{height}", channels=there)


def _inspect_tiff(path: Path) -> tuple[bool, bool]:
    """Return whether a file that begins like a TIFF is a shot of Panchroma, and whether it is a DNG
    or has a mosaic, as cameras' files with names in .tif do beside a picture to look at.

    LibRaw must not get our shots: it treats a 6 x 6 pattern as X-Trans and other periods as four
    colours, and decodes them wrongly without an error. Their private data may be in the directory
    of the preview or of the samples.
    """
    try:
        with opened_tiff(path, {TAG["DNGPrivateData"]}) as (_, file, _), guarded(path):
            first: Any = file.pages[0]
            directories = [first, *(first.pages or ())]
            private = (directory.tags.get(TAG["DNGPrivateData"]) for directory in directories)
            is_shot = any(tag and bytes(tag.value).startswith(MAKER.encode()) for tag in private)
            mosaic = any(page.photometric == Photometric.CFA for page in directories)
            return is_shot, mosaic or TAG["DNGVersion"] in first.tags
    # A damaged directory: the next decoder will report it, but LibRaw must not get a shot of ours.
    except InputError:
        return MAKER.encode() in _ends(path), False


def _ends(path: Path) -> bytes:
    """Return the beginning and the end of a file, where directories and their data are."""
    with path.open("rb") as file:
        start = file.read(_END)
        file.seek(max(len(start), path.stat().st_size - _END))
        return start + file.read()


def _remark_on_losses(path: Path) -> tuple[str, ...]:
    """Return a note for the user on what a photographer has noted in a file and no shot keeps."""
    ends = _ends(path)
    lost = [name for name, pattern in _NOTED.items() if re.search(pattern, ends)]
    return (f"not kept: the {' and '.join(lost)} in the file (XMP, IPTC)",) if lost else ()
