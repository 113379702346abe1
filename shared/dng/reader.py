"""Parsing untrusted DNG files, which may be truncated, edited or malicious.

tifffile parses the directories. Samples are decoded only after the declared sizes have been
compared with the size of the file.
"""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from io import SEEK_END
from itertools import product
from typing import IO

import imagecodecs
import numpy as np
from tifffile import TiffFile, TiffPage

from ..arrays import CodeArray
from ..errors import InputError, is_program_fault
from ..jpeg_check import LOSSLESS, read_header
from ..reading import File, naming, opened_file
from ..tiff import LARGEST_TIFF
from ..tiff_reading import PLAIN, check_directories, check_page
from .tags import CFA_CODES, TAG, Compression, Photometric

# tifffile logs every odd field. Applications may listen; by default the messages are dropped.
logging.getLogger("tifffile").addHandler(logging.NullHandler())

_JPEG_START = b"\xff\xd8\xff"
_LARGEST_PREVIEW = 256 << 20


@contextmanager
def opened(path: File) -> Iterator["DngReader"]:
    """Parse a DNG for the duration of a `with` block. Raises InputError that names the file when it
    is damaged.
    """
    with naming(path), opened_file(path, LARGEST_TIFF, "a DNG of Panchroma") as stream:
        start = stream.read(4)
        if start.startswith(_JPEG_START):
            raise InputError("a JPEG picture, not a DNG; `panchroma simulate` makes a shot of it")
        if start not in (b"II*\0", b"MM\0*"):
            starts = "it does not begin like a TIFF file; give a shot of Panchroma"
            raise InputError(f"not a DNG: {starts}")
        check_directories(stream)
        with library():
            file = TiffFile(stream, name="DNG", **PLAIN)  # a temporary file is called by a number
        yield DngReader(stream, file)


@contextmanager
def library(fault: str = "its parts contradict each other") -> Iterator[None]:
    """Raise InputError for whatever a library raises in a `with` block, which calls no function of
    Panchroma: a fault of the program is no damage of the file.
    """
    try:
        yield
    # Deliberately every class: on damaged bytes tifffile and imagecodecs raise a dozen, none with a
    # message for users.
    except Exception as error:
        if isinstance(error, MemoryError) or is_program_fault(error):
            raise
        raise damaged(fault) from error


def damaged(what: str) -> InputError:
    """An InputError that calls the file damaged."""
    return InputError(f"damaged: {what}; copy the file again")


class DngReader:
    """The two directories of a DNG, and its `stream`. Methods raise InputError for what is
    damaged.
    """

    def __init__(self, stream: IO[bytes], file: TiffFile) -> None:
        self.stream = stream
        self._size = stream.seek(0, SEEK_END)
        with library():
            self._main = file.pages.first
        check_page(self._main)

    def stored(self, tag: int, page: TiffPage | None = None) -> bytes:
        """The bytes of a field in a directory, None = the first; empty when there is none."""
        field = (page or self._main).tags.get(tag)
        return b"" if field is None else self._bytes(field.valueoffset, field.valuebytecount)

    def preview(self) -> bytes:
        """The JPEG of the first directory, unchanged; b"" if an editor has removed it."""
        page = self._main
        if self._check_segments(page) <= _LARGEST_PREVIEW and page.compression == Compression.JPEG:
            jpegs = list(self._segments(page))
            if jpegs == [b""] or (len(jpegs) == 1 and jpegs[0].startswith(_JPEG_START)):
                return jpegs[0]
        raise InputError("the file has no JPEG preview")

    def raw(self) -> TiffPage:
        """The directory of the raw samples, which lies below the first directory."""
        with library():
            pages = list(self._main.pages or ())
        for page in pages:
            if isinstance(page, TiffPage) and page.subfiletype == 0:
                check_page(page)
                return page
        raise damaged("the file has no raw picture")

    def cfa(self) -> tuple[str, ...] | None:
        """Return the letters of one period of the CFA by rows, "?" for unknown ones; None if the
        mosaic is grey (LinearRaw).
        """
        page = self.raw()
        if page.photometric == Photometric.LINEAR_RAW:
            return None
        if page.photometric != Photometric.CFA:
            raise damaged(f"PhotometricInterpretation of the raw samples is {page.photometric}")
        with library():
            rows, columns = map(int, page.tags.valueof(TAG["CFARepeatPatternDim"]))
        codes = self.stored(TAG["CFAPattern"], page)
        if len(codes) != rows * columns or not codes:
            raise damaged(f"CFAPattern has {len(codes)} entries, expected {rows} x {columns}")
        letters = {code: letter for letter, code in CFA_CODES.items()}
        tile = "".join(letters.get(code, "?") for code in codes)
        return tuple(tile[start : start + columns] for start in range(0, len(tile), columns))

    def samples(self, max_pixels: int, planes: int = 1, page: TiffPage | None = None) -> CodeArray:
        """The samples in a directory, None = the raw ones, uint16 (H, W), or (H, W, planes) if
        there are several; sizes are checked before anything is decoded.
        """
        page = page or self.raw()
        kind, depth = page.dtype, () if planes == 1 else (planes,)
        if len(page.shape) < 2 or page.shape[2:] != depth or kind not in (np.uint8, np.uint16):
            expected = "expected whole numbers (rows, columns)"
            raise damaged(f"the raw samples are {kind} {page.shape}, {expected}")
        rows, columns = page.shape[:2]
        if rows * columns > max_pixels:
            limit = f"the limit is {max_pixels}, `max_pixels` raises it"
            raise InputError(f"the file declares {columns} x {rows} pixels; {limit}")
        held = self._check_segments(page)
        # lossless JPEG needs three bytes per sample at worst; a mebibyte is always harmless
        if held > 4 * rows * columns * planes + (1 << 20):
            raise damaged(f"{held} bytes of samples for {columns} x {rows} pixels")
        if page.compression not in tuple(Compression):
            remedy = "a mosaic is lossless JPEG or uncompressed; export it again so"
            raise InputError(f"compression {page.compression}; {remedy}")
        compressed = page.compression == Compression.JPEG
        bits = 1 if compressed else page.bitspersample  # a Huffman code has at least one bit
        if held * 8 < rows * columns * planes * bits:
            fault = f"its {held} bytes of samples cannot hold them"
            raise damaged(f"the file declares {columns} x {rows} pixels, {fault}")
        if compressed:
            samples = self._decoded(page)
        else:
            with library():
                samples = np.ascontiguousarray(page.asarray(maxworkers=1), np.uint16)
        samples.flags.writeable = False  # so that a mosaic need not copy them
        return samples

    def _decoded(self, page: TiffPage) -> CodeArray:
        """Decode and assemble strips or tiles of lossless JPEG.

        tifffile must not do it: where libjpeg-turbo refuses a damaged JPEG, tifffile tries a second
        decoder, which can crash.
        """
        rows, columns, *planes = page.shape
        strip = page.rowsperstrip, columns
        tall, wide = (page.tilelength, page.tilewidth) if page.is_tiled else strip
        if min(tall, wide) < 1 or -(-rows // tall) * -(-columns // wide) != len(page.dataoffsets):
            raise damaged(f"its strips or tiles of {wide} x {tall} pixels are too many, or too few")
        samples = np.empty(page.shape, np.uint16)
        corners = product(range(0, rows, tall), range(0, columns, wide))
        for (top, left), segment in zip(corners, self._segments(page), strict=True):
            frame = read_header(segment)
            if frame.kind != LOSSLESS:
                raise damaged("the raw samples are not a lossless JPEG")
            # A sample has at least one bit.
            frame.check(8 * len(segment) // max(1, frame.components))
            room = samples[top : top + tall, left : left + wide]
            with library():
                decoded = imagecodecs.jpeg8_decode(segment)
            if decoded.shape == samples.shape and decoded.dtype == np.uint16:  # it is all of them
                return decoded
            # Some writers store the same samples as a JPEG of twice the components and half the
            # width.
            with library():
                room[...] = decoded.reshape(-1, wide, *planes)[: room.shape[0], : room.shape[1]]
        return samples

    def _check_segments(self, page: TiffPage) -> int:
        """Total bytes of all strips or tiles, which must lie inside the file and cannot hold more
        than it does.
        """
        ends = map(sum, zip(page.dataoffsets, page.databytecounts, strict=True))
        held = sum(page.databytecounts)
        if max([held, *ends]) > self._size:
            raise damaged(f"the file ends before its samples do, after {self._size} bytes")
        if min([held, *page.dataoffsets, *page.databytecounts]) < 0:
            raise damaged("its samples begin before the file does")
        return held

    def _segments(self, page: TiffPage) -> Iterator[bytes]:
        for offset, size in zip(page.dataoffsets, page.databytecounts, strict=True):
            yield self._bytes(offset, size)

    def _bytes(self, offset: int, size: int) -> bytes:
        self.stream.seek(offset)
        return self.stream.read(size)
