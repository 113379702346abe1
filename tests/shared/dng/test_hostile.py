"""Files that are torn, flipped, foreign, or made to do harm: each is refused, or read as it was
written.
"""

import struct
import time
import tracemalloc
from itertools import product

import numpy as np
import pytest

from panchroma.shared import CfaPattern, InputError, Mosaic
from panchroma.shared.dng import codec, decode_dng, decode_preview, encode_dng
from panchroma.shared.dng.container import main_directory, raw_digest, raw_directory
from panchroma.shared.dng.record import encode_record, record_id
from panchroma.shared.dng.tags import TAG, Photometric
from panchroma.shared.tiff import Directory, Fields, FieldType, encode_tiff
from tests.shared.dng.examples import METADATA, calibration, mosaic, preview, same

MIXED = r"damaged: (the record .* is that of another shot|its parts are not all)"
LIMIT_SECONDS, LIMIT_BYTES = 1.0, 300e6


def written(
    shot: Mosaic, fields: Fields | None = None, strips: list[bytes] | None = None
) -> tuple[Directory, bytes]:
    """The directories of a shot's file, whose raw directory says what is given besides, and the
    record of the shot.
    """
    raw, digest = raw_directory(shot.codes, 12, Photometric.LINEAR_RAW), raw_digest(shot.codes)
    raw.fields.update(fields or {})
    raw.strips = raw.strips if strips is None else strips
    main = main_directory(preview(), METADATA, "Panchroma", raw, digest)
    return main, encode_record(shot, digest, main.strips[0])


def sealed(main: Directory, record: bytes, identity: str | None) -> bytes:
    """A file of these directories with this record and identity; None = left out."""
    main.fields[TAG["DNGPrivateData"]] = FieldType.BYTE, record
    if identity is not None:
        main.fields[TAG["RawDataUniqueID"]] = FieldType.BYTE, identity.encode()
    return encode_tiff(main)


def tampered(
    fields: Fields, strips: list[bytes] | None = None, shot: Mosaic | None = None
) -> bytes:
    """A file of ours, record, digest and all, whose raw directory says something else."""
    main, record = written(mosaic(CfaPattern.bayer(9)) if shot is None else shot, fields, strips)
    return sealed(main, record, record_id(record))


def long(**values: int) -> Fields:
    """Fields of one number by the names of their tags."""
    return {TAG[name]: (FieldType.LONG, [value]) for name, value in values.items()}


def sides(rows: int, columns: int) -> Fields:
    return long(ImageLength=rows, RowsPerStrip=rows, ImageWidth=columns)


def assert_refused_cheaply(data: bytes, match: str) -> None:
    tracemalloc.start()
    start = time.perf_counter()
    with pytest.raises(InputError, match=match):
        decode_dng(data)
    assert time.perf_counter() - start < LIMIT_SECONDS
    assert tracemalloc.get_traced_memory()[1] < LIMIT_BYTES
    tracemalloc.stop()


@pytest.mark.parametrize(
    "letters", ["paper", "WYWC/YWCW/WCWM/CWMW", "ABCDW/EFGHW/WWWWW/WWWWW/WWWWW"]
)
def test_a_flipped_bit_is_told_or_harmless(letters: str) -> None:
    original = mosaic(CfaPattern.of_letters(letters), (13, 17))
    data, random = encode_dng(original, preview(8, 8)), np.random.default_rng(300)
    # Half of them in the directories, which are a small part of the file and the dangerous one.
    firsts = (0, 8 * (len(data) - 1200))
    bits = [random.integers(first, 8 * len(data), 300) for first in firsts]
    for bit in np.concatenate(bits).tolist():
        flipped = bytearray(data)
        flipped[bit // 8] ^= 1 << bit % 8
        try:
            read = decode_dng(bytes(flipped))
        except InputError:
            continue
        assert same(read, original), f"bit {bit}"


def test_a_torn_file_is_told() -> None:
    data = encode_dng(mosaic(), preview())
    for size in np.random.default_rng(1).integers(1, len(data), 100).tolist():
        with pytest.raises(InputError):
            decode_dng(data[:size])
    ends = r"damaged: the file ends after 3000 bytes.*copy the file again"
    with pytest.raises(InputError, match=ends):
        decode_dng(data[:3000])


def test_absurd_sizes_and_other_kinds_of_samples_are_refused_before_they_are_decoded() -> None:
    wrong = (
        (sides(60000, 60000), "declares 60000 x 60000 pixels; the limit is 268435456"),
        (sides(16000, 16000), "its .* bytes of samples cannot hold them"),
        (sides(2**32 - 1, 2**32 - 1), "the limit is"),
        (long(ImageWidth=0), "damaged"),
        (long(ImageDepth=10**6), "expected whole numbers"),
        (long(PhotometricInterpretation=2), "PhotometricInterpretation of the raw samples is 2"),
        (long(NewSubfileType=1), "no raw picture"),
    )
    for fields, words in wrong:
        assert_refused_cheaply(tampered(fields), words)


def test_the_callers_limit_counts() -> None:
    data = encode_dng(mosaic(shape=(20, 30)), preview())
    assert decode_dng(data, max_pixels=600).shape == (20, 30)
    with pytest.raises(InputError, match="30 x 20 pixels; the limit is 599"):
        decode_dng(data, max_pixels=599)


def test_a_jpeg_that_declares_more_than_it_holds_is_refused() -> None:
    original = mosaic(CfaPattern.bayer(9))
    (jpeg,) = raw_directory(original.codes, 12, Photometric.LINEAR_RAW).strips
    frame = jpeg.index(b"\xff\xc3") + 5
    assert struct.unpack_from(">HH", jpeg, frame) == original.shape
    huge = jpeg[:frame] + struct.pack(">HH", 65500, 65500) + jpeg[frame + 4 :]
    assert_refused_cheaply(tampered({}, [huge]), "a JPEG declares more pixels")
    lossy = jpeg.replace(b"\xff\xc3", b"\xff\xc0", 1)
    assert_refused_cheaply(tampered({}, [lossy]), "not a lossless JPEG")
    # a good frame behind a bad one
    hidden = huge.replace(b"\xff\xc3", b"\xff\xc0", 1)[: frame + 6 + 3] + jpeg[frame - 5 :]
    assert_refused_cheaply(tampered({}, [hidden]), "not a lossless JPEG")
    assert_refused_cheaply(tampered({}, [jpeg[:30] * 200]), "damaged")


def test_strips_must_lie_in_the_file_and_side_by_side() -> None:
    original = mosaic(CfaPattern.bayer(9))
    many = long(RowsPerStrip=1, Compression=1, BitsPerSample=16)
    strips = [row.tobytes() for row in original.codes]
    data = tampered(many, strips)
    assert same(decode_dng(data), original)
    sizes = struct.pack("<37I", *[53 * 2] * 37)
    assert data.count(sizes) == 1
    for size, words in ((len(data) // 2, "before its samples do"), (1, "cannot hold them")):
        assert_refused_cheaply(data.replace(sizes, struct.pack("<37I", *[size] * 37)), words)
    assert_refused_cheaply(tampered(many, strips[:-1]), "damaged")


def test_tiles_of_jpeg_are_put_together() -> None:
    """Adobe's converter cuts the samples into tiles, and counts two columns as two components."""
    original = mosaic(CfaPattern.bayer(9), (37, 53))
    padded = np.pad(original.codes, ((0, 11), (0, 11)))
    tiles = padded.reshape(3, 16, 2, 32).swapaxes(1, 2).reshape(6, 16, 32)
    strips = [raw_directory(tile, 12, Photometric.LINEAR_RAW).strips[0] for tile in tiles]
    assert same(decode_dng(tampered(long(TileWidth=32, TileLength=16), strips)), original)


def test_changed_samples_are_told() -> None:
    other = mosaic(CfaPattern.bayer(9)).codes.copy()
    other[5, 5] ^= 1
    with pytest.raises(InputError, match=r"damaged: the samples differ .*NewRawImageDigest"):
        decode_dng(tampered({}, list(raw_directory(other, 12, Photometric.LINEAR_RAW).strips)))


def test_a_shot_is_not_put_together_from_two() -> None:
    """The same camera, the same size: only the samples, or only the calibration, are of another
    shot.
    """
    one = mosaic(CfaPattern.bayer(9))
    for other in (
        Mosaic(one.codes[::-1].copy(), one.pattern, one.calibration, one.metadata),
        Mosaic(one.codes, one.pattern, calibration(gamma=(0.5, 0.6, 0.7)), one.metadata),
        Mosaic(one.codes, CfaPattern.bayer(9, "BGGR"), one.calibration, one.metadata),
    ):
        shots = [one, other]
        for samples, record, identity in product((0, 1), (0, 1), (0, 1, None)):
            (main, _), (_, stated) = written(shots[samples]), written(shots[record])
            named = None if identity is None else record_id(written(shots[identity])[1])
            data = sealed(main, stated, named)
            if np.array_equal(shots[samples].codes, shots[record].codes) and identity == record:
                assert same(decode_dng(data), shots[record])
            else:
                with pytest.raises(InputError, match=MIXED):
                    decode_dng(data)


@pytest.mark.parametrize("shape", [(37, 53), (24, 36)])
def test_a_changed_shape_is_told(shape: tuple[int, int]) -> None:
    """Up to 256 x 256 pixels NewRawImageDigest is that of the samples in a row, whatever their
    shape.
    """
    original = mosaic(CfaPattern.bayer(9), shape)
    rows, columns = shape
    others = (
        (columns, rows),
        (rows * 2, columns // 2),
        (rows // 2, columns * 2),
        (rows - 1, columns),
    )
    for changed in (*others, (1, rows * columns)):
        fields = sides(*changed) | long(Compression=1, BitsPerSample=16)
        with pytest.raises(InputError, match="damaged: the samples"):
            decode_dng(tampered(fields, [original.codes.tobytes()], original))


def test_an_exchanged_preview_is_told_by_verify_only() -> None:
    original = mosaic()
    data = bytearray(encode_dng(original, preview()))
    # far behind the tables: any bytes decode to some picture
    place = data.index(decode_preview(bytes(data))) + 800
    data[place : place + 8] = bytes(byte ^ 0x11 for byte in data[place : place + 8])
    assert same(decode_dng(bytes(data)), original)
    with pytest.raises(InputError, match="damaged: the preview"):
        codec.verify(bytes(data))
