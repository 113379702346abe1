"""What is written is read; two decoders by others return every sample of a lossless JPEG.

Files that are torn, flipped, foreign, or made to do harm: each is refused, or read as it was
written.
"""

import json
import struct
from collections.abc import Callable
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from tifffile import TiffFile, TiffPage

from panchroma.shared import CfaPattern, InputError, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.calibration import BITS
from panchroma.shared.colorimetry import D50
from panchroma.shared.dng import encode_dng, read_dng, read_preview, record, verify_dng, write_dng
from panchroma.shared.dng.container import main_directory, raw_digest, raw_directory
from panchroma.shared.dng.lossless_jpeg import encode_lossless
from panchroma.shared.dng.record import RECORD_ID, decode_record, encode_record
from panchroma.shared.dng.tags import TAG, Photometric
from panchroma.shared.pattern import BAYER_ORDERS, PERIODS
from panchroma.shared.tiff import Directory, Fields, FieldType, encode_tiff
from tests.scenes import darker_corners
from tests.shared.dng.examples import METADATA, calibration, mosaic, preview, same

# --- codec ----------------------------------------------------------------------------------------


def pages(data: bytes) -> tuple[dict[int, Any], dict[int, Any]]:
    """Values by tag of the first and of the raw directory, as an independent reader finds them."""
    with TiffFile(BytesIO(data)) as file:
        main = file.pages.first
        raw = main.pages[0]
        assert isinstance(raw, TiffPage)
        return {tag.code: tag.value for tag in main.tags}, {tag.code: tag.value for tag in raw.tags}


def assert_refused(data: bytes, match: str) -> None:
    with pytest.raises(InputError, match=match):
        read_dng(BytesIO(data))


def assert_survives(original: Mosaic) -> None:
    read = read_dng(BytesIO(encode_dng(original, preview())))
    assert read.samples.dtype == np.uint16
    assert same(read, original)
    assert read.metadata == original.metadata


@pytest.mark.parametrize(
    "original",
    [
        *(mosaic(CfaPattern.bayer(period, "GRBG", (period - 1, 1))) for period in PERIODS),
        *(mosaic(CfaPattern.bayer(6, order, (5, 3))) for order in BAYER_ORDERS),
        *(mosaic(calibrated=calibration(bits=bits)) for bits in BITS),
        *(mosaic(shape=shape) for shape in ((6, 6), (7, 301), (300, 13), (257, 256))),
        mosaic(calibrated=calibration(black_level=(3.0,) * 4, white_level=200)),  # 8 bits
        mosaic(calibrated=calibration(neutral=(0.5,) * 3, neutral_estimated=True)),
        mosaic(calibrated=calibration(shading=darker_corners((37, 53)))),
        Mosaic(mosaic().samples, CfaPattern.bayer(6), SensorCalibration()),  # and no metadata
        mosaic().in_scene_units(),  # as codes
    ],
)
def test_every_mosaic_survives(original: Mosaic) -> None:
    assert_survives(original)


@pytest.mark.parametrize(
    ("pattern", "planes"),
    [
        (CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW"), [5, 3, 4, 6]),
        (CfaPattern(CfaPattern.bayer(4).tile, (1, 2), "BRG"), [2, 0, 1, 6]),
        (CfaPattern.of_letters("K=8"), [0, 1, 2, 6]),
        (CfaPattern.of_letters("K=9"), None),
        (CfaPattern.of_letters("RWW/WBW/WWW", channels="RB"), None),
        (CfaPattern.of_letters("GBW/CWW/WWW"), None),
        (CfaPattern.of_letters("RGW/BCW/WWW"), None),
        (CfaPattern.of_letters("RGW/KWW/WWW"), None),
    ],
)
def test_colours_are_stated_in_the_order_of_the_channels_or_the_picture_is_grey(
    pattern: CfaPattern, planes: Any
) -> None:
    """DNG has no words for a period above 8, two channels or four, a mixture of the other two, a
    letter without a code.
    """
    original = mosaic(pattern)
    assert_survives(original)
    main, raw = pages(encode_dng(original, preview()))
    assert raw[262] == (32803 if planes else 34892)
    if planes:
        assert list(raw[50710]) == planes
        codes = dict(zip(pattern.planes, planes, strict=True))
        assert list(raw[33422]) == [codes[letter] for letter in "".join(pattern.letters_from())]
        assert (len(main[50721]), len(main[50728])) == (2 * 12, 2 * 4)


def test_an_uncalibrated_filter_of_two_colours_reads_half_of_each() -> None:
    pattern = CfaPattern.of_letters("WYWC/YWCW/WCWM/CWMW")
    plain = mosaic(pattern, calibrated=SensorCalibration.of_bits(12, channels=pattern.channels))
    matrix = np.array(pages(encode_dng(plain, preview()))[0][50721]).reshape(4, 3, 2)
    seen = (matrix[..., 0] / matrix[..., 1]) @ D50
    np.testing.assert_allclose(seen / seen[-1], [1 / 3, 1 / 3, 1 / 3, 1], rtol=1e-3)


def test_black_levels_are_stated_per_pixel_where_planes_differ_and_otherwise_once() -> None:
    pattern = CfaPattern.bayer(4, origin=(1, 3))
    original = mosaic(pattern, calibrated=calibration(black_level=(200.0, 210.0, 220.25, 230.0)))
    raw = pages(encode_dng(original, preview()))[1]
    levels = np.array(raw[50714]).reshape(4, 4, 2)
    expected = np.array(original.calibration.black_level)[pattern.filter_map((4, 4))]
    np.testing.assert_array_equal(levels[..., 0] / levels[..., 1], expected)
    assert (raw[50713], raw[50717]) == ((4, 4), original.calibration.white_level)
    assert_survives(original)
    for period, blacks, level in ((4, (200.0,) * 4, 200), (12, (200.0, 210.0, 220.0, 230.0), 230)):
        shot = mosaic(CfaPattern.bayer(period), calibrated=calibration(black_level=blacks))
        raw = pages(encode_dng(shot, preview()))[1]
        assert (raw[50713], raw[50714]) == ((1, 1), level)


def test_noise_profile_is_that_of_normalised_samples() -> None:
    original = mosaic(calibrated=calibration(bits=16))
    calibrated = original.calibration
    raw = pages(encode_dng(original, preview()))[1]
    profile, full = np.array(raw[51041]).reshape(-1, 2), calibrated.full_scale
    for plane, (slope, floor) in enumerate(profile):
        told = np.sqrt(slope * 0.4 / full + floor) * full  # at 0.4 scene units
        assert told == pytest.approx(calibrated.noise.sigma(0.4, plane), rel=1e-12)
    grey = pages(encode_dng(mosaic(CfaPattern.bayer(9), calibrated=calibrated), preview()))[1]
    assert tuple(grey[51041]) == tuple(profile[-1])
    gaussian = mosaic(calibrated=calibration(noise=NoiseModel.gaussian(0.01, 4)))
    assert min(pages(encode_dng(gaussian, preview()))[1][51041]) > 0


def test_digest_is_adobes() -> None:
    # The figures that Adobe's DNG SDK 1.7.1 finds for these samples
    # (dng_negative::FindNewRawImageDigest).
    samples = np.arange(300 * 280, dtype=np.uint32).astype(np.uint16).reshape(300, 280)
    assert raw_digest(samples).hex() == "93531235569db4d81a0ae06c25f8d9fd"
    planes = np.stack([samples, samples[::-1], samples.T.reshape(300, 280)], axis=-1)
    assert raw_digest(planes).hex() == "0ac03a8130d6b0ac9bf47effb07a8953"


def test_record_is_named_survives_padding_and_tells_any_change() -> None:
    original = mosaic()
    data, _ = encode_record(original, b"digest", b"preview")
    assert data.startswith(b"Panchroma mosaic\0")
    assert decode_record(data + b"\0") == decode_record(data)  # exiftool pads
    assert original.calibration.id.encode() in data
    others = (RECORD_ID + other for other in (b"", b"[1]", b"{}", b"\xff"))
    for changed in (data.replace(b'"W', b'"G'), data[:-1], *others):
        with pytest.raises(InputError, match="damaged: the record"):
            decode_record(changed)


def test_a_record_whose_digest_is_right_may_still_be_wrong() -> None:
    document = json.loads(encode_record(mosaic(), b"1", b"2")[0].removeprefix(RECORD_ID))
    del document["digest"]
    for name, value in (
        ("shape", ["a", "b"]),
        ("schema", 2),
        ("samples", 7),
        ("pattern", {"tile": [1], "origin": [0, 0], "channels": "RGB"}),
        ("pattern", {**document["pattern"], "origin": [10**400, 0]}),
        ("calibration", {**document["calibration"], "gamma": [10**400, 1, 1]}),
        ("shading", {"gain": [[["1"] * 4] * 4] * 4, "size": [24, 24]}),
    ):
        changed = {**document, name: value}
        data = RECORD_ID + json.dumps({**changed, "digest": record._digest(changed)}).encode()
        with pytest.raises(InputError):
            decode_record(data)


def test_two_patterns_that_disagree_are_both_named() -> None:
    data = encode_dng(mosaic(CfaPattern.bayer(3)), preview())
    tile = bytes([0, 1, 6, 1, 2, 6, 6, 6, 6])
    assert data.count(tile) == 1
    other = data.replace(tile, bytes([0, 2, 6, 1, 1, 6, 6, 6, 6]))
    assert_refused(other, r"says RBW GGW WWW.*DNGPrivateData says RGW GBW WWW")


# --- lossless jpeg --------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [10, 12, 13, 14, 16])
@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (7, 1), (67, 101), (70, 2100), (40, 31, 3)])
def test_every_sample_comes_back(bits: int, shape: tuple[int, ...]) -> None:
    random = np.random.default_rng(0)
    top = (1 << bits) - 1
    even = random.integers(0, top, shape, endpoint=True)
    noisy = np.clip(random.normal(top / 3, 20, shape), 0, top)
    # unlike the rows that are counted
    surprise = np.where(np.arange(shape[0]).reshape(-1, *[1] * (len(shape) - 1)) % 32, even, 0)
    extremes = even % 2 * top, np.zeros(shape), np.full(shape, top), even % 2 * (top // 2 + 1)
    for samples in (even, noisy, surprise, *extremes):
        codes = samples.astype(np.uint16)
        jpeg = encode_lossless(codes, bits)
        np.testing.assert_array_equal(imagecodecs.jpeg8_decode(jpeg).reshape(shape), codes)
        if len(shape) == 2 and shape[1] > 1:
            np.testing.assert_array_equal(imagecodecs.ljpeg_decode(jpeg), codes)


def test_takes_hardly_more_than_the_best_code() -> None:
    """Close to what libjpeg needs, which counts every sample before it chooses a code."""
    codes = np.random.default_rng(0).normal(900, 40, (300, 400)).astype(np.uint16)
    best = imagecodecs.jpeg8_encode(codes, lossless=True, predictor=1, bitspersample=12)
    assert len(encode_lossless(codes, 12)) < 1.01 * len(best)


# --- files ---------------------------------------------------------------------------------------


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    read = read_dng(str(path))
    assert same(read, mosaic())
    with pytest.raises(ValueError, match="read-only"):
        read.samples[0, 0] = np.uint16(1)
    assert verify_dng(path) == read.shape


def test_a_refused_mosaic_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^[^:]*shot\.dng: the preview is float64") as caught:
        write_dng(tmp_path / "shot.dng", mosaic(), preview() / 2)  # type: ignore[arg-type]
    assert str(caught.value).count("shot.dng") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("read", [read_dng, read_preview, verify_dng])
def test_what_cannot_be_read_is_named_once(tmp_path: Path, read: Callable[[Path], Any]) -> None:
    whole, path = encode_dng(mosaic(), preview()), tmp_path / "shot.dng"
    for content, reason in (
        (None, "there is no such file"),
        (b"", "the file is empty"),
        (b"\x89PNG", "not a DNG"),
        (b"II*\0", "damaged"),
        (b"II*\0\x08\0\0\0\0\0\0\0\0\0", ""),
        (read_preview(BytesIO(whole)), "a JPEG picture, not a DNG"),
        (whole[: len(whole) // 2], "damaged: the file ends after"),
    ):
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError) as caught:
            read(path)
        assert str(caught.value).startswith(f"{path}: {reason}")
        assert str(caught.value).count("shot.dng") == 1


def test_a_file_larger_than_a_tiff_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_dng(path, mosaic(), preview())
    with path.open("r+b") as file:
        file.truncate((1 << 32) + 1)
    with pytest.raises(InputError, match="larger than the 4294967296 bytes of a DNG of Panchroma"):
        read_dng(path)


# --- hostile --------------------------------------------------------------------------------------

MIXED = r"damaged: (the record .* is that of another shot|its parts are not all)"


def written(
    shot: Mosaic, fields: Fields | None = None, strips: list[bytes] | None = None
) -> tuple[Directory, bytes, str]:
    """The directories of a shot's file, whose raw directory says what is given besides, the record
    of the shot, and its identity.
    """
    raw, digest = raw_directory(shot.codes, 12, Photometric.LINEAR_RAW), raw_digest(shot.codes)
    raw.fields.update(fields or {})
    raw.strips = raw.strips if strips is None else strips
    main = main_directory(preview(), METADATA, "Panchroma", raw, digest)
    return main, *encode_record(shot, digest, main.strips[0])


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
    return sealed(*written(shot or mosaic(CfaPattern.bayer(9)), fields, strips))


def long(**values: int) -> Fields:
    """Fields of one number by the names of their tags."""
    return {TAG[name]: (FieldType.LONG, [value]) for name, value in values.items()}


def sides(rows: int, columns: int) -> Fields:
    return long(ImageLength=rows, RowsPerStrip=rows, ImageWidth=columns)


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
            read = read_dng(BytesIO(flipped))
        except InputError:
            continue
        assert same(read, original), f"bit {bit}"


def test_samples_before_the_file_are_refused() -> None:
    data, offset = encode_dng(mosaic(), preview()), struct.pack("<HHI", TAG["StripOffsets"], 4, 1)
    place = data.index(offset)  # of the raw directory
    signed = struct.pack("<HHIi", TAG["StripOffsets"], 9, 1, -30)
    assert_refused(data[:place] + signed + data[place + len(signed) :], "before the file")


def test_absurd_sizes_and_other_kinds_of_samples_are_refused_before_they_are_decoded() -> None:
    for fields, words in (
        (sides(60000, 60000), "declares 60000 x 60000 pixels; the limit is 268435456"),
        (sides(16000, 16000), "its .* bytes of samples cannot hold them"),
        (sides(2**32 - 1, 2**32 - 1), "the limit is"),
        (long(ImageWidth=0), "damaged"),
        (long(ImageDepth=10**6), "expected whole numbers"),
        (long(PhotometricInterpretation=2), "PhotometricInterpretation of the raw samples is 2"),
        (long(NewSubfileType=1), "no raw picture"),
    ):
        assert_refused(tampered(fields), words)


def test_the_callers_limit_counts() -> None:
    data = encode_dng(mosaic(shape=(20, 30)), preview())
    assert read_dng(BytesIO(data), max_pixels=600).shape == (20, 30)
    with pytest.raises(InputError, match="30 x 20 pixels; the limit is 599"):
        read_dng(BytesIO(data), max_pixels=599)


def test_a_jpeg_that_declares_more_than_it_holds_is_refused() -> None:
    original = mosaic(CfaPattern.bayer(9))
    (jpeg,) = raw_directory(original.codes, 12, Photometric.LINEAR_RAW).strips
    frame = jpeg.index(b"\xff\xc3") + 5
    assert struct.unpack_from(">HH", jpeg, frame) == original.shape
    huge = jpeg[:frame] + struct.pack(">HH", 65500, 65500) + jpeg[frame + 4 :]
    assert_refused(tampered({}, [huge]), "a JPEG declares more pixels")
    lossy = jpeg.replace(b"\xff\xc3", b"\xff\xc0", 1)
    assert_refused(tampered({}, [lossy]), "not a lossless JPEG")
    # a good frame behind a bad one
    hidden = huge.replace(b"\xff\xc3", b"\xff\xc0", 1)[: frame + 6 + 3] + jpeg[frame - 5 :]
    assert_refused(tampered({}, [hidden]), "not a lossless JPEG")
    assert_refused(tampered({}, [jpeg[:30] * 200]), "damaged")


def test_strips_must_lie_in_the_file_and_side_by_side() -> None:
    original = mosaic(CfaPattern.bayer(9))
    many = long(RowsPerStrip=1, Compression=1, BitsPerSample=16)
    strips = [row.tobytes() for row in original.codes]
    data = tampered(many, strips)
    assert same(read_dng(BytesIO(data)), original)
    sizes = struct.pack("<37I", *[53 * 2] * 37)
    assert data.count(sizes) == 1
    for size, words in ((len(data) // 2, "before its samples do"), (1, "cannot hold them")):
        assert_refused(data.replace(sizes, struct.pack("<37I", *[size] * 37)), words)
    assert_refused(tampered(many, strips[:-1]), "damaged")


def test_tiles_of_jpeg_are_put_together() -> None:
    """Adobe's converter cuts the samples into tiles, and counts two columns as two components."""
    original = mosaic(CfaPattern.bayer(9), (37, 53))
    padded = np.pad(original.codes, ((0, 11), (0, 11)))
    tiles = padded.reshape(3, 16, 2, 32).swapaxes(1, 2).reshape(6, 16, 32)
    strips = [raw_directory(tile, 12, Photometric.LINEAR_RAW).strips[0] for tile in tiles]
    assert same(read_dng(BytesIO(tampered(long(TileWidth=32, TileLength=16), strips))), original)


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
        for samples, stating, identity in product((0, 1), (0, 1), (0, 1, None)):
            main, stated = written(shots[samples])[0], written(shots[stating])[1]
            named = None if identity is None else written(shots[identity])[2]
            data = sealed(main, stated, named)
            if np.array_equal(shots[samples].codes, shots[stating].codes) and identity == stating:
                assert same(read_dng(BytesIO(data)), shots[stating])
            else:
                assert_refused(data, MIXED)


@pytest.mark.parametrize("shape", [(37, 53), (24, 36)])
def test_a_changed_shape_is_told(shape: tuple[int, int]) -> None:
    """Up to 256 x 256 pixels NewRawImageDigest is that of the samples in a row, whatever their
    shape.
    """
    original = mosaic(CfaPattern.bayer(9), shape)
    rows, columns = shape
    halves = (rows * 2, columns // 2), (rows // 2, columns * 2)
    for changed in (*halves, (columns, rows), (rows - 1, columns), (1, rows * columns)):
        fields = sides(*changed) | long(Compression=1, BitsPerSample=16)
        data = tampered(fields, [original.codes.tobytes()], original)
        assert_refused(data, "damaged: the samples")


def test_an_exchanged_preview_is_told_by_verify_only() -> None:
    original = mosaic()
    data = bytearray(encode_dng(original, preview()))
    # far behind the tables: any bytes decode to some picture
    place = data.index(read_preview(BytesIO(data))) + 800
    data[place : place + 8] = bytes(byte ^ 0x11 for byte in data[place : place + 8])
    assert same(read_dng(BytesIO(data)), original)
    with pytest.raises(InputError, match="damaged: the preview"):
        verify_dng(BytesIO(data))
