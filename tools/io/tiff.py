"""TIFF pictures."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from ...shared import DoubleArray, InputError
from ...shared.colorimetry import D65_XY
from ...shared.dng.exif import read_metadata
from ...shared.dng.tags import TAG, tags_of
from ...shared.tiff_reading import PLAIN, check_directories, check_page
from . import decoders
from .damage import check_strips, data_bytes, guarded
from .decoders import Decoded, PictureFormat, channels_of, remark_on_unused
from .encoding import SRGB, Curve, Encoding, exif_encoding, profile_encoding, space_of, table_curve
from .scene import RGB, check_size

# TIFF 6.0, sections 8 and 20; the ICC profile.
_MAX_SAMPLE = "MaxSampleValue", "SMaxSampleValue"
_READ = tags_of("WhitePoint PrimaryChromaticities InterColorProfile " + " ".join(_MAX_SAMPLE))
_RATIONALS = (5, 10)  # field types RATIONAL and SRATIONAL
_MOST_PAGES = 26  # that are taken together: one more than a pattern has channels
_ALPHA = (1, 2)  # ExtraSamples: associated and unassociated
# None, LZW, Deflate (two codes), PackBits, LZMA, Zstandard. All others declare a size of their own,
# which decoders believe.
_COMPRESSIONS = (1, 5, 8, 32946, 32773, 34925, 50000)
# NewSubfileType (TIFF 6.0; DNG 1.7.1, chapter 4): of a page, and of what is beside pictures
_PAGE = 2
_PAGE_KINDS = {4: "a transparency mask", 8: "a depth map", 16: "an enhanced picture"}
_PAGE_KINDS |= {65540: "a semantic mask"}
_SMALL = 1 << 22  # pixels of all tiles together that are harmless, however small the picture


def decode_tiff(path: Path, max_pixels: int, channels: str) -> Decoded:
    """Decode the first full picture of a TIFF, integer or floating point: grey, RGB, or a sample
    for each of `channels`.

    Pages with one sample each, all of one size and kind, are taken together as such samples.
    """
    import tifffile

    size, held, notes, most = path.stat().st_size, data_bytes(path), list[str](), 1
    with opened_tiff(path, _READ) as (stream, file, several):
        if several:
            with suppress(InputError):  # pages behind a damaged one are left out
                check_directories(stream, {*tifffile.TIFF.TAG_LOAD, *_READ}, _MOST_PAGES)
                most = _MOST_PAGES
        full, others = _full_pictures(file, most)
        first = full[0]
        check_page(first)
        if first.photometric not in {tifffile.PHOTOMETRIC.MINISBLACK, tifffile.PHOTOMETRIC.RGB}:
            kind = f"the TIFF is of kind {getattr(first.photometric, 'name', first.photometric)}"
            raise InputError(f"{kind}; convert it to RGB or grey")
        kinds = {(page.shape, page.bitspersample, page.dtype, page.photometric) for page in full}
        pages = full if first.samplesperpixel == 1 == len(kinds) else [first]
        samples = first.samplesperpixel
        if not samples or first.imagedepth != 1 or first.tiledepth != 1:
            found = f"{samples} samples per pixel and {first.imagedepth} planes in depth"
            raise InputError(f"the TIFF has {found}; expected a picture")
        count = samples * len(pages)
        is_rgb = first.photometric == tifffile.PHOTOMETRIC.RGB and count == len(RGB)
        declared = is_rgb or any(kind in _ALPHA for kind in first.extrasamples)
        letters = channels_of(count, channels, notes, declared=declared, pages=len(pages))
        # a grey scene has three planes as well
        pixel_bytes = max(count, 3) * max(1, first.bitspersample // 8)
        check_size(first.imagewidth, first.imagelength, pixel_bytes, held, max_pixels)
        offsets = [offset for page in pages for offset in page.dataoffsets]
        lengths = [length for page in pages for length in page.databytecounts]
        check_strips(offsets, lengths, size, first.imagewidth * first.imagelength * len(pages))
        planes = [_page_pixels(page) for page in pages]
        pixels = planes[0] if len(planes) == 1 else np.concatenate(planes, axis=-1)
        if not letters:
            pixels = decoders.without_alpha(pixels, notes)
        if len(pages) == 1 and (len(full) > 1 or (several and most == 1)):
            notes.append("the file has several pages; only the first is used")
        remark_on_unused(others, notes)
        peak = _peak(first, pixels, notes)
        with guarded(path):
            profile = bytes(first.tags.valueof(TAG["InterColorProfile"], b""))
        encoding = profile_encoding(profile, notes) or _declared(first, notes)
        if encoding is None and peak:
            encoding = exif_encoding(stream, notes)
        metadata = read_metadata(stream)
    return Decoded(pixels, peak, encoding, metadata, notes, letters or RGB)


def _peak(page: Any, pixels: NDArray[Any], notes: list[str]) -> int | None:
    """Return the integer that stands for 1.0; None for floating point. notes: gets a remark for the
    user.

    A largest sample of 2^n - 1 says that the samples have n bits. Any other is a figure of the
    picture (TIFF 6.0, MaxSampleValue).
    """
    if pixels.dtype.kind != "u":
        return None
    peak = (1 << page.bitspersample) - 1
    if TAG["TransferFunction"] in page.tags:  # a table for all samples
        return peak
    stated = max(chain(*(tag_numbers(page, name) for name in _MAX_SAMPLE)), default=peak)
    largest = int(stated) if 255 <= stated < peak else peak
    if largest == peak or largest & (largest + 1) or pixels.max(initial=0) > largest:
        return peak
    notes.append(f"the file says that its largest sample is {largest}, which is taken for white")
    return largest


def _declared(page: Any, notes: list[str]) -> Encoding | None:
    """Return the encoding in the fields of the TIFF itself: TransferFunction, PrimaryChromaticities
    and WhitePoint, as far as they are those of colours.

    notes: gets a remark for the user.
    """
    white = tag_numbers(page, "WhitePoint") if TAG["WhitePoint"] in page.tags else D65_XY
    to_xyz = space_of((*tag_numbers(page, "PrimaryChromaticities"), *white))
    curves: tuple[Curve, ...] = ()
    if TAG["TransferFunction"] in page.tags:
        values, stated = 1 << page.bitspersample, tag_numbers(page, "TransferFunction")
        if page.bitspersample <= 16 and stated.size in (values, 3 * values):
            tables = stated.reshape(-1, values) / 65535
            curves = tuple(table_curve(table) for table in np.broadcast_to(tables, (3, values)))
        else:
            remark_on_unused(["TransferFunction"], notes)
    if not (curves or to_xyz):
        return None
    return Encoding(curves, to_xyz or SRGB.to_xyz, "the fields of the TIFF")


@contextmanager
def opened_tiff(path: Path, read: set[int]) -> Iterator[tuple[IO[bytes], Any, bool]]:
    """In the `with` block: a file, the `tifffile.TiffFile` in it, and whether it has more than one
    page.

    Raises InputError if the fields that are read, beside those of every picture, are implausible.
    """
    import tifffile

    with path.open("rb") as stream:
        several = check_directories(stream, {*tifffile.TIFF.TAG_LOAD, *read})
        with guarded(path):
            file = tifffile.TiffFile(stream, **PLAIN)
        with file:
            yield stream, file, several


def tag_numbers(page: Any, name: str) -> DoubleArray:
    """Return the numbers of a field of a page of tifffile, fractions as quotients; empty if there
    is none.
    """
    field = page.tags.get(TAG[name])
    if field is None:
        return np.zeros(0)
    with guarded():
        values = np.ravel(np.asarray(field.value, np.float64))
    if field.dtype not in _RATIONALS:
        return values
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(values[::2] / values[1::2])


def _full_pictures(file: Any, most: int) -> tuple[list[Any], list[str]]:
    """Return the full picture of each page of a TIFF, `most` at most: the largest of the page and
    those below it that is no preview; and names of what the pages have beside them.
    """
    trees: list[list[Any]] = []
    # len(file.pages) would follow the directories, however many there are
    with guarded(), suppress(IndexError):
        while len(trees) < most:
            page = file.pages[len(trees)]
            trees.append([page, *(page.pages or ())])
    full: list[Any] = []
    for tree in trees:
        pictures = [page for page in tree if page.subfiletype in (0, _PAGE)]
        for page in pictures:
            check_page(page)
        full += sorted(pictures, key=lambda page: -page.imagewidth * page.imagelength)[:1]
    return full or trees[0][:1], beside(chain(*trees))


def beside(pages: Iterable[Any]) -> list[str]:
    """Return names of what pages of a TIFF are, beside pictures and previews."""
    kinds = {page.subfiletype for page in pages}
    return [name for kind, name in _PAGE_KINDS.items() if kind in kinds]


def _page_pixels(page: Any) -> NDArray[Any]:
    """The samples of a page, (H, W, C)."""
    if page.compression not in _COMPRESSIONS:
        name = getattr(page.compression, "name", page.compression)
        remedy = "save it with LZW or ZIP (Deflate) compression, or with none"
        raise InputError(f"the TIFF is compressed with {name}; {remedy}")
    if page.is_tiled:  # tiles are decoded whole, also where they lie outside the picture
        covered = page.tilewidth * page.tilelength * len(page.dataoffsets)
        pixels = page.imagewidth * page.imagelength
        if covered > max(_SMALL, 4 * page.samplesperpixel * pixels):
            tiles = f"the tiles of the TIFF hold {covered} pixels, the picture {pixels}"
            raise InputError(f"{tiles}: it is made to fill the memory")
    with guarded():
        samples: NDArray[Any] = page.asarray(maxworkers=1)
    return np.moveaxis(samples, 0, -1) if page.axes.startswith("S") else np.atleast_3d(samples)


# A DNG begins as a TIFF does, and so do most camera RAWs: see `load_scene`.
TIFF = PictureFormat("TIFF", rb"II\*\0|MM\0\*|II\+\0|MM\0\+", (".tif", ".tiff"), decode_tiff)
