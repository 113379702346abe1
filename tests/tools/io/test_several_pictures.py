"""Files that hold several pictures: the full one is the scene, and a note names what is left out,
but for previews and smaller copies.
"""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenEXR
import pytest
import tifffile
from PIL import Image

from panchroma.shared.errors import InputError
from panchroma.tools.simulation.load import load_scene
from tests.tools.io.files import ASCII, BYTE, CFA, LINEAR_RAW, LONG, SHORT, noise, png

DEPTH, SEMANTIC, ENHANCED = 8, 65540, 16
_UNUSED = 32  # in place of SEMANTIC, which tifffile takes for a mask of one bit
DNG: list[Any] = [(50706, BYTE, 4, (1, 4, 0, 0), True), (50708, ASCII, 0, "Test camera", True)]
BAYER: list[Any] = [(33421, SHORT, 2, (2, 2), True), (33422, BYTE, 4, (0, 1, 1, 2), True)]


class Page(NamedTuple):
    """A page of a TIFF: samples, NewSubfileType, PhotometricInterpretation."""

    samples: Any
    kind: int = 0
    photometric: int = 2


def colours(rows: int, columns: int, kind: int = 0) -> Page:
    return Page(noise(rows, columns, 3), kind)


def grey(rows: int, columns: int, kind: int = 0) -> Page:
    return Page(noise(rows, columns), kind, 1)


def mask(rows: int, columns: int, kind: int = 4) -> Page:
    return Page(noise(rows, columns) > 2000, kind, 4)


def mosaic(rows: int = 60, columns: int = 80) -> Page:
    return Page(noise(rows, columns), 0, CFA)


def linear(rows: int = 60, columns: int = 80, kind: int = 0) -> Page:
    return Page(noise(rows, columns, 3), kind, LINEAR_RAW)


def write(
    path: Path, first: Page, below: Sequence[Page] = (), then: Sequence[Page] = (), tags: Any = ()
) -> str:
    """Write a TIFF: its first page, pages below that and pages behind it. tags: of the first."""
    with tifffile.TiffWriter(path, byteorder="<") as file:
        for page in (first, *below, *then):
            kind = page.kind if page.kind != SEMANTIC else _UNUSED
            options: dict[str, Any] = {"photometric": page.photometric, "subfiletype": kind}
            options["extratags"] = [*(BAYER if page.photometric == CFA else ())]
            if page.photometric == LINEAR_RAW:
                options["planarconfig"] = "contig"  # tifffile 2026.11 writes separate planes
            if page is first:
                options["subifds"] = len(below)
                options["extratags"] += [*tags]
            file.write(page.samples, metadata=None, **options)
    unused, semantic = (struct.pack("<HHII", 254, LONG, 1, kind) for kind in (_UNUSED, SEMANTIC))
    path.write_bytes(path.read_bytes().replace(unused, semantic))
    return str(path)


ONLY_FIRST = ("the file has several pages; only the first is used",)


@pytest.mark.parametrize(
    ("pages", "notes"),
    [
        ((colours(8, 10, 1), [colours(60, 80)]), ()),
        ((colours(8, 10, 1), [colours(30, 40, 1), colours(60, 80)]), ()),
        ((colours(8, 10), [colours(60, 80)]), ()),  # a preview that is not marked
        ((colours(8, 10, 1), [], [colours(60, 80)]), ()),
        ((colours(60, 80), [colours(30, 40, 1), colours(15, 20, 1)]), ()),  # a pyramid
        ((colours(60, 80), [], [colours(30, 40, 1), mask(60, 80)]), ("a transparency mask",)),
        ((colours(60, 80), [], [mask(30, 40, 5), grey(60, 80, DEPTH)]), ("a depth map",)),
        ((colours(60, 80), [], [colours(60, 80), colours(60, 80)]), ONLY_FIRST),
        ((colours(60, 80, 2), [], [colours(30, 40, 2)]), ONLY_FIRST),
    ],
)
def test_the_scene_of_a_tiff_is_its_full_picture(tmp_path: Path, pages: Any, notes: Any) -> None:
    scene = load_scene(write(tmp_path / "a.tif", *pages), linear=True)
    np.testing.assert_allclose(scene.rgb, noise(60, 80, 3) / 65535, atol=1e-6)
    expected = notes if notes in ((), ONLY_FIRST) else (f"not used: {notes[0]}",)
    assert tuple(note for note in scene.notes if "no sample is above" not in note) == expected


def test_pages_of_grey_are_a_stack_without_their_smaller_copies(tmp_path: Path) -> None:
    planes = [grey(60, 80) for _ in range(3)]
    copies = [grey(30, 40, 1)]
    path = write(tmp_path / "a.tif", planes[0], copies, [*planes[1:], *copies])
    stacked = load_scene(path, linear=True).rgb
    np.testing.assert_allclose(stacked[..., 1], planes[0].samples / 65535, rtol=1e-6)
    path = write(tmp_path / "b.tif", copies[0], [], planes)
    assert load_scene(path, linear=True).shape == (60, 80)


@pytest.mark.parametrize(
    ("first", "below", "shape", "names"),
    [
        (
            colours(8, 10, 1),
            [mosaic(), linear(120, 160, ENHANCED)],
            (30, 40),
            "an enhanced picture",
        ),
        (mosaic(), [linear(60, 80, ENHANCED)], (30, 40), "an enhanced picture"),
        (colours(200, 300, 1), [mosaic(), grey(90, 70, DEPTH)], (30, 40), "a depth map"),
        (
            colours(8, 10, 1),
            [Page(noise(90, 120), SEMANTIC, 52527), linear(), mask(60, 80)],
            (60, 80),
            "a transparency mask, a semantic mask",
        ),
        (linear(), [linear(120, 160, ENHANCED)], (60, 80), "an enhanced picture"),
        (colours(8, 10, 1), [linear(), colours(200, 300, 65537)], (60, 80), ""),
    ],
)
def test_the_scene_of_a_dng_is_its_main_picture(
    tmp_path: Path, first: Page, below: list[Page], shape: tuple[int, int], names: str
) -> None:
    scene = load_scene(write(tmp_path / "a.dng", first, below, tags=DNG))
    assert scene.shape == shape
    notes = [note for note in scene.notes if note.startswith("not used")]
    assert notes == ([f"not used: {names}"] if names else [])


def test_the_preview_of_a_raw_is_not_its_scene(tmp_path: Path) -> None:
    """Some cameras' RAWs are named like pictures."""
    pages = colours(8, 10, 1), [mosaic(), colours(30, 40, 1)]
    assert load_scene(write(tmp_path / "a.tif", *pages)).shape == (30, 40)
    with pytest.raises(InputError):
        load_scene(write(tmp_path / "b.tif", pages[0], [], pages[1]))
    path = Path(write(tmp_path / "c.dng", *pages, tags=DNG))
    entry = struct.pack("<HHII", 259, SHORT, 1, 1)
    data = path.read_bytes()
    for unknown in (52546, 34713, 9):  # JPEG XL, Nikon's and JBIG of a mosaic
        at = data.index(entry, data.index(entry) + 1)
        changed = struct.pack("<HHII", 259, SHORT, 1, unknown)
        path.write_bytes(data[:at] + changed + data[at + len(entry) :])
        with pytest.raises(InputError):
            load_scene(str(path))


def test_pictures_behind_the_first_one_of_a_jpeg_are_told(tmp_path: Path) -> None:
    pictures = [Image.fromarray(noise(40, 60, 3, dtype=np.uint8)) for _ in range(3)]
    path = tmp_path / "a.jpg"
    pictures[0].save(path, format="MPO", save_all=True, append_images=pictures[1:])
    (note,) = load_scene(str(path)).notes
    assert note == "not used: 2 more in the file: only the first picture is"
    data = bytearray(path.read_bytes())
    # the entries lie behind the directory, whose last field they are
    first = data.index(struct.pack("<HHI", 0xB002, 7, 48)) + 16
    assert struct.unpack_from("<I", data, first) == (0x30000,)
    previews = []
    for entry in (first + 16, first + 32):  # previews in full HD, as many cameras write them
        struct.pack_into("<I", data, entry, 0x10002)
        path.write_bytes(data)
        previews.append(load_scene(str(path)).notes)
    assert previews == [("not used: 1 more in the file: only the first picture is",), ()]


def test_an_animation_is_told(tmp_path: Path) -> None:
    path = png(tmp_path / "a.png", noise(40, 60, 3, dtype=np.uint8), acTL=struct.pack(">II", 2, 0))
    assert load_scene(path).notes == ("not used: the animation",)


def test_the_part_of_an_exr_that_has_colours_is_the_scene(tmp_path: Path) -> None:
    light = noise(40, 60, 4).astype(np.float32) / 4096
    named = dict(zip("RGBA", np.moveaxis(light, 2, 0).copy(), strict=True))
    adobe = {"chromaticities": (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.329)}
    depth, rgb = {"Z": light[..., 0].copy()}, {name: named[name] for name in "RGB"}
    planes = {"depth": depth, "sun": named, "other": rgb}
    parts = [OpenEXR.Part(dict(adobe), channels, name) for name, channels in planes.items()]
    OpenEXR.File(parts).write(str(tmp_path / "a.exr"))
    scene = load_scene(str(tmp_path / "a.exr"))
    np.testing.assert_array_equal(scene.rgb, light[..., :3])
    assert np.array(scene.camera_to_xyz)[0, 0] > 0.5  # Adobe RGB's
    assert scene.notes == ("not used: 2 more parts of the EXR",)
    OpenEXR.File(parts[:1]).write(str(tmp_path / "b.exr"))
    with pytest.raises(InputError, match="has the channels Z"):
        load_scene(str(tmp_path / "b.exr"))
