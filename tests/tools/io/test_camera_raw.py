"""Camera RAWs and linear DNGs: the step from quads to pixels, levels, colours, and sensors that
have no quads.

Clipped samples of a scene are white in its own white balance, without rings; and told.
"""

from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rawpy
import tifffile
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from panchroma.shared import CodeArray, FloatArray, InputError
from panchroma.shared.colorimetry import D50, adaptation, xyz
from panchroma.shared.lights import ILLUMINANTS, illuminant_xy, temperature, to_one
from panchroma.shared.pattern import BAYER_ORDERS
from panchroma.tools.io.camera_raw import bayer_filters, raw_directories
from panchroma.tools.io.clipped import saturation, with_white_highlights
from panchroma.tools.io.scene import Scene
from panchroma.tools.simulation.load import load_scene
from tests.tools.io import files
from tests.tools.io.files import (
    LINEAR_RAW,
    RATIONAL,
    SHORT,
    SRATIONAL,
    Fields,
    noise,
    rationals,
    write_dng,
)

# --- camera raw -----------------------------------------------------------------------------------

# XYZ -> camera for D65, as a real camera's: Nikon D50 in the tables of dcraw.
MATRIX = np.array([[7732, -2422, -789], [-8238, 15884, 2498], [-859, 783, 7330]]) / 10000
NEUTRAL = (0.5, 1.0, 0.625)
UNKNOWN_COLOURS = "the camera's colour matrix is unknown: colours can be balanced, but not matched"


def loaded(path: Path, *arguments: Any, **options: Any) -> Scene:
    """The scene in a DNG with these samples, quads as they are. Arguments: of `write_dng`."""
    return load_scene(write_dng(path / "a.dng", *arguments, **options), registered=False)


@pytest.mark.parametrize("order", BAYER_ORDERS)
def test_quads_of_every_order_become_pixels(tmp_path: Path, order: str) -> None:
    """Of an odd size: the last row and the last column are left out."""
    samples = noise(61, 83)
    scene = loaded(tmp_path, samples, order, fields={50714: (SHORT, [100]), 50717: (SHORT, [4095])})
    signal = (samples[:60, :82] - 100.0) / 3995
    quads = signal.reshape(30, 2, 41, 2).swapaxes(1, 2).reshape(30, 41, 4)
    letters = np.array([*order])
    planes = [quads[..., letters == channel].mean(axis=-1) for channel in "RGB"]
    np.testing.assert_allclose(scene.rgb, np.stack(planes, axis=-1), atol=1e-6)


def test_black_of_rows_and_columns_is_subtracted(tmp_path: Path) -> None:
    """With the black level that LibRaw knows, which is their mean."""
    down, across = np.arange(60) - 29.5, np.arange(84) / 2 - 20.75
    levels: Fields = {50714: (SHORT, [164]), 50717: (SHORT, [4095])}
    deltas = {50716: (SRATIONAL, rationals(down)), 50715: (SRATIONAL, rationals(across))}
    lit = np.rint(1164 + down[:, None] + across).astype(np.uint16)
    scene = loaded(tmp_path, lit, fields=levels | deltas)
    np.testing.assert_allclose(scene.rgb, 1000 / 3931, atol=0.6 / 3931)


@pytest.mark.parametrize("order", BAYER_ORDERS)
def test_red_and_blue_are_interpolated_to_the_middle_of_a_quad(tmp_path: Path, order: str) -> None:
    y, x = np.indices((80, 96)).astype(np.float64)
    light = 2000 + 900 * np.sin(2 * np.pi * y / 23) * np.cos(2 * np.pi * x / 31)  # of all filters
    samples, fields = np.rint(light).astype(np.uint16), {50717: (SHORT, [4000])}
    path = write_dng(tmp_path / "a.dng", samples, order, fields=fields)
    quads, registered = (load_scene(path, registered=how).rgb[4:-4, 4:-4] for how in (False, True))
    apart, left = (np.abs(rgb[..., ::2] - rgb[..., 1:2]).max() for rgb in (quads, registered))
    assert apart > 0.03
    assert left < 0.004  # the mean of two greens is a little less than the light between them
    np.testing.assert_array_equal(quads[..., 1], registered[..., 1])


def test_a_unit_matrix_is_none(tmp_path: Path) -> None:
    fields = {50721: (SRATIONAL, rationals(np.eye(3))), 50728: (RATIONAL, rationals(NEUTRAL))}
    scene = loaded(tmp_path, noise(60, 80), fields=fields)
    assert scene.camera_to_xyz is None
    assert list(scene.notes) == [UNKNOWN_COLOURS]


@pytest.mark.parametrize("orientation", range(10))
def test_turned_and_mirrored_is_a_raw_as_its_first_directory_says(
    tmp_path: Path, orientation: int
) -> None:
    """If it says nothing, as LibRaw finds it elsewhere. 0 and 9 are no orientations."""
    stated, other = {274: (SHORT, [orientation])}, {274: (SHORT, [6])}
    valid = orientation if orientation in range(1, 9) else 1
    for first, below in ((stated, {}), (stated, other), (None, stated)):
        scene = loaded(tmp_path, noise(60, 80), fields=below, above=first)
        assert scene.metadata.orientation == valid
    if valid == orientation:
        scene = loaded(tmp_path, noise(60, 80), fields=stated, above={})
        assert scene.metadata.orientation == orientation


OWN = {
    50723: np.array([[1.12, 0.03, 0], [0, 1, 0.02], [0.04, 0, 0.82]]),
    50724: np.array([[0.9, 0, 0.05], [0.01, 1.05, 0], [0, 0.06, 1.2]]),
}
BALANCE = (1.9, 1.0, 1.4)


def calibrated(share: float, own: Any = OWN) -> tuple[Any, Any]:
    """What white reads at a share of the way from light A to D65, and the matrix from camera RGB to
    XYZ, as DNG 1.7.1 has them in chapter 6.
    """
    first, second = (temperature(ILLUMINANTS[name]) for name in ("A", "D65"))
    kelvin = 1 / ((1 - share) / first + share / second)
    white = illuminant_xy(str(round(kelvin)))
    share = (1 / temperature(white) - 1 / first) / (1 / second - 1 / first)
    ours, model = (
        (1 - share) * warm + share * cold for warm, cold in (own.values(), TWO_LIGHTS.values())
    )
    to_camera = np.diag(BALANCE) @ ours @ model
    neutral = to_camera @ xyz(*white)
    matrix = adaptation(xyz(*white)) @ np.linalg.inv(to_camera)
    return white, (neutral / neutral.max(), matrix * neutral.max())


# both read 1 of D50 at most, so that the scale of neither counts
TWO_LIGHTS = {50721: to_one(MATRIX + 0.04), 50722: to_one(MATRIX)}
NO_OWN = dict.fromkeys(OWN, np.eye(3))


@pytest.mark.parametrize("kind", [files.CFA, LINEAR_RAW])
@pytest.mark.parametrize("share", [0.2, 0.6])
@pytest.mark.parametrize("by_neutral", [True, False])
def test_a_camera_differs_from_its_model_as_its_dng_says(
    tmp_path: Path, kind: int, share: float, by_neutral: bool
) -> None:
    white, (neutral, expected) = calibrated(share)
    matrices = {**TWO_LIGHTS, **OWN}
    fields: Fields = {tag: (SRATIONAL, rationals(matrix)) for tag, matrix in matrices.items()}
    fields |= {50727: (RATIONAL, rationals(BALANCE)), 50778: (SHORT, [17]), 50779: (SHORT, [21])}
    fields |= {50931: (files.ASCII, "Works"), 50932: (files.ASCII, "Works")}
    stated = (50728, neutral) if by_neutral else (50729, white)
    fields[stated[0]] = (RATIONAL, rationals(stated[1]))
    samples = noise(60, 80) if kind == files.CFA else noise(60, 80, 3)
    scene = loaded(tmp_path, samples, kind=kind, fields=fields)
    assert scene.neutral == pytest.approx(neutral, abs=1e-3)
    np.testing.assert_allclose(scene.camera_to_xyz, expected, atol=0.01)
    assert not scene.notes
    fields |= {50932: (files.ASCII, "Others"), 52531: fields[50721]}
    _, (neutral, without) = calibrated(share, NO_OWN)
    fields[50728] = (RATIONAL, rationals(neutral))
    scene = loaded(tmp_path, samples, kind=kind, fields=fields)
    np.testing.assert_allclose(scene.camera_to_xyz, without, atol=0.01)
    assert np.abs(without - expected).max() > 0.03
    assert list(scene.notes) == ["not used: the colour matrix for a third light"]


@pytest.mark.parametrize("own", [np.eye(3), *OWN.values()])
def test_colours_of_a_camera_unlike_its_model_under_one_light(tmp_path: Path, own: Any) -> None:
    to_camera = np.diag(BALANCE) @ own @ MATRIX
    neutral = to_camera @ xyz(*ILLUMINANTS["D65"])
    neutral /= neutral.max()
    fields = {50721: MATRIX, 50723: own}
    entries: Fields = {tag: (SRATIONAL, rationals(matrix)) for tag, matrix in fields.items()}
    entries |= {50727: (RATIONAL, rationals(BALANCE)), 50728: (RATIONAL, rationals(neutral))}
    scene = loaded(tmp_path, noise(60, 80), fields=entries | {50778: (SHORT, [21])})
    shown = np.array(scene.camera_to_xyz) @ to_camera
    expected = adaptation(xyz(*ILLUMINANTS["D65"]))
    np.testing.assert_allclose(shown / shown[1, 1], expected / expected[1, 1], atol=1e-3)


@pytest.mark.parametrize("factors", [{}, {50728: (RATIONAL, rationals(np.ones(3)))}])
def test_without_white_balance_one_is_estimated_and_said(tmp_path: Path, factors: Fields) -> None:
    """Equal factors are none: a photographer's "UniWB"."""
    rng = np.random.default_rng(0)
    shade = rng.uniform(0.1, 0.9, (30, 40, 1)) * (0.5, 1.0, 0.7) * 4000
    samples = shade[..., [0, 1, 1, 2]].reshape(30, 40, 2, 2).swapaxes(1, 2).reshape(60, 80)
    white: Fields = {50717: (SHORT, [4000])}
    scene = loaded(tmp_path, samples.astype(np.uint16), fields=white | factors)
    assert scene.neutral == pytest.approx((0.5, 1.0, 0.7), abs=0.005)
    assert scene.neutral_estimated
    assert any("no white balance" in note and "0.500, 1.000" in note for note in scene.notes)
    assert scene.camera_to_xyz is None
    black = loaded(tmp_path, np.zeros((60, 80), np.uint16))
    assert black.neutral is None
    assert any("too dark" in note for note in black.notes)


@pytest.mark.parametrize("order", "<>")
def test_a_raw_that_is_no_tiff_states_its_capture_data_in_the_first_that_it_holds(
    tmp_path: Path, order: Any
) -> None:
    data, options = b"FUJIFILMCCD-RAW II*", {"byteorder": order, "metadata": None}
    for make in ("First", "Second"):
        fields = [(271, "s", 0, make, True)]
        tifffile.imwrite(file := BytesIO(), np.zeros((1, 1), np.uint8), extratags=fields, **options)
        data += file.getvalue()
    (tmp_path / "other.raf").write_bytes(data)
    assert raw_directories(tmp_path / "other.raf").main[271].data == b"First\0"


@pytest.mark.parametrize("letters", ["RGEB", "CMYG"])
def test_other_quads_are_refused(letters: str) -> None:
    """Sensors of which no file is at hand, as LibRaw describes them."""
    raw = SimpleNamespace(raw_type=rawpy.RawType.Flat, raw_image=1, num_colors=4)
    raw.color_desc, raw.raw_pattern = letters.encode(), np.arange(4).reshape(2, 2)
    with pytest.raises(InputError, match=f"the filters are {letters}"):
        bayer_filters(raw)


# --- linear DNGs ---------------------------------------------------------------------------------

SHAPE = (40, 52, 3)
LOSSLESS = {"lossless": True, "predictor": 1, "bitspersample": 16}
JPEG: dict[str, Any] = {"compression": "jpeg", "compressionargs": LOSSLESS, "bitspersample": 16}
CAMERA: Fields = {
    50721: (SRATIONAL, rationals(((0.8, -0.2, -0.1), (-0.4, 1.2, 0.2), (-0.1, 0.2, 0.6)))),
    50778: (SHORT, [21]),
    50728: (RATIONAL, rationals(NEUTRAL)),
    274: (SHORT, [6]),
    271: (files.ASCII, "Contax"),
}


def codes(dtype: Any = np.uint16) -> Any:
    values = np.random.default_rng(0).integers(0, 60000, SHAPE)
    return values.astype(dtype) if np.dtype(dtype).kind == "u" else (values / 65536).astype(dtype)


def save(
    path: Path, samples: Any, fields: Fields | None = None, *, below: bool = True, **options: Any
) -> str:
    """A linear DNG, its samples in the first directory or below it; fields: of the samples'
    directory.
    """
    where: Any = {"fields": fields, "above": CAMERA}
    if not below:
        where = {"fields": {**CAMERA, **(fields or {})}}
    return write_dng(path, samples, kind=LINEAR_RAW, **where, **options)


@pytest.mark.parametrize("below", [True, False])
@pytest.mark.parametrize(
    ("dtype", "options"),
    [
        (np.uint16, {}),
        (np.uint16, {"tile": (16, 32)}),
        (np.uint16, {"compression": "deflate", "rowsperstrip": 16}),
        (np.uint16, {"compression": "deflate", "predictor": True, "tile": (32, 16)}),
        (np.uint16, {**JPEG, "tile": (32, 16)}),
        (np.float32, {}),
        (np.float32, {"compression": "deflate", "predictor": True, "tile": (16, 16)}),
        (np.float16, {"compression": "deflate", "predictor": True}),
    ],
)
def test_samples_of_every_lossless_kind(
    tmp_path: Path, dtype: Any, options: dict[str, Any], below: bool
) -> None:
    samples = codes(dtype)
    scene = load_scene(save(tmp_path / "x.dng", samples, below=below, **options))
    peak = 65535 if samples.dtype.kind == "u" else 1
    np.testing.assert_allclose(scene.rgb, samples.astype(np.float64) / peak, atol=1e-6)
    assert scene.neutral == pytest.approx(NEUTRAL)
    assert not scene.neutral_estimated
    np.testing.assert_allclose(np.array(scene.camera_to_xyz) @ NEUTRAL, D50, atol=1e-4)
    assert (scene.metadata.orientation, scene.metadata.make) == (6, "Contax")


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_phone_s_picture_is_a_scene(tmp_path: Path, dtype: Any) -> None:
    """As ProRAW has it: tiles that reach beyond the picture, a table, levels, a crop and a wish to
    be brightened.
    """
    row, column = np.indices((300, 400))
    light = np.stack([0.1 + row / 600, 0.2 + column / 700, 0.5 - row / 900], axis=2)
    most = int(np.iinfo(dtype).max)
    table = np.square(np.arange(most + 1) / most) * 60000 + 528  # finer steps in the dark
    fields: Fields = {
        50712: (SHORT, np.rint(table).astype(int).tolist()),
        50714: (SHORT, (528, 528, 528)),
        50717: (files.LONG, (60528,)),
        50719: (RATIONAL, rationals((8, 6))),
        50720: (RATIONAL, rationals((380, 290))),
    }
    samples = np.rint(np.sqrt(light) * most).astype(dtype)
    bits = {"bitspersample": 8 * samples.itemsize}
    options: Any = {**JPEG, **bits, "compressionargs": {**LOSSLESS, **bits}, "tile": (128, 256)}
    options["above"] = {**CAMERA, 50730: (SRATIONAL, rationals((1.5,)))}
    path = write_dng(tmp_path / "a.dng", samples, kind=LINEAR_RAW, fields=fields, **options)
    scene = load_scene(path)
    expected = light[6:296, 8:388]
    assert scene.rgb.shape == expected.shape
    assert np.sqrt(np.square(scene.rgb - expected).mean()) < 0.01
    assert scene.metadata.orientation == 6
    assert any("+1.5 stops brighter (BaselineExposure)" in note for note in scene.notes)


@pytest.mark.parametrize("options", [{}, {"compression": "deflate"}])
@pytest.mark.parametrize("black", [500, 20000])
def test_each_plane_has_a_limit_of_its_own(
    tmp_path: Path, black: int, options: dict[str, Any]
) -> None:
    rng = np.random.default_rng(2)
    light = np.full((60, 80, 3), 0.2) * NEUTRAL
    light[10:40, 20:60] *= 9.5
    samples = black + (60000 - black) * (light + rng.normal(0, 0.003, light.shape) * np.sqrt(light))
    samples = np.minimum(samples, (60000, 55000, 57000)) + rng.normal(0, 50, light.shape)
    fields: Fields = {50714: (SHORT, (black,) * 3), 50717: (files.LONG, (60000,) * 3)}
    stored = np.rint(samples).astype(np.uint16)
    scene = load_scene(save(tmp_path / "x.dng", stored, fields, **options))
    balanced = scene.rgb[12:38, 22:58] / NEUTRAL
    assert (np.ptp(balanced, axis=2) / balanced.max(axis=2)).max() < 0.02
    assert balanced.min() > 1.3


def test_levels_and_active_area(tmp_path: Path) -> None:
    samples = np.minimum(codes(), 38000)  # nothing is clipped
    black = np.array([[[100, 200, 300], [110, 210, 310]]])
    fields: Fields = {
        50713: (SHORT, (1, 2)),
        50714: (RATIONAL, rationals(black)),
        50715: (SRATIONAL, rationals(np.arange(48) / 4)),
        50717: (files.LONG, (60000, 50000, 40000)),
        50829: (files.LONG, (2, 3, 38, 51)),
        50719: (SHORT, (8, 6)),
        50720: (SHORT, (50, 40)),  # a crop that reaches beyond the area is ignored
    }
    path = save(tmp_path / "x.dng", samples, fields)
    levels = np.tile(black, (36, 24, 1)) + np.arange(48)[None, :, None] / 4
    ranges = np.array((60000, 50000, 40000)) - levels.max(axis=(0, 1))
    expected = (samples[2:38, 3:51] - levels) / ranges
    np.testing.assert_allclose(load_scene(path).rgb, expected.clip(0), atol=1e-5)


def test_the_rim_of_a_clipped_sky_has_no_colour_after_the_registration(tmp_path: Path) -> None:
    y, x = np.indices((80, 96))
    light = 0.2 + 1.4 / (1 + np.exp((y + 0.3 * x - 50) / 1.2))  # a roof before a sky
    signal = np.choose(y % 2 + x % 2, NEUTRAL) * light
    samples = np.minimum(np.rint(4000 * signal), 4000).astype(np.uint16)
    fields = {50717: (SHORT, [4000]), 50728: (RATIONAL, rationals(NEUTRAL))}
    scene = load_scene(write_dng(tmp_path / "a.dng", samples, fields=fields))
    rgb = scene.rgb[3:-3, 3:-3] / NEUTRAL
    assert rgb.max() > 1
    assert (np.ptp(rgb, axis=2) / rgb.mean(axis=2)).max() < 0.05  # 0.5 without registration


# --- clipped --------------------------------------------------------------------------------------


def colour(rgb: FloatArray) -> FloatArray:
    """How far each pixel is from grey once balanced, 0 to 1."""
    balanced = rgb / np.array(NEUTRAL, np.float32)
    return np.asarray(np.ptp(balanced, axis=2) / balanced.max(axis=2))


def test_a_burnt_out_lamp_has_no_ring() -> None:
    """The samples of a quad lie side by side, which gives the rim of any lamp colour."""
    row, column = np.indices((80, 90)) - np.reshape((40, 45), (2, 1, 1))
    places = (column - 0.25, column, column + 0.25)
    levels = [0.2 + 6 * np.exp(-(row**2 + place**2) / 8) for place in places]
    light = np.stack(levels, axis=2).astype(np.float32) * np.array(NEUTRAL, np.float32)
    found, _ = with_white_highlights(light.clip(0, 1), NEUTRAL)
    assert colour(found).max() < 0.75 * colour(light).max()


BLACK, WHITE = 600, 16383


def exposed(limits: tuple[int, ...], noise: float = 0.0) -> tuple[CodeArray, NDArray[np.bool_]]:
    """RGGB samples of a bright sky, grey ground with a red lamp and hot pixels, seen through a
    lens that darkens the corners, with the noise of light; and which samples are clipped.

    limits: codes at which the four filters clip; noise: of the electronics after that, codes.
    """
    rng, (rows, columns) = np.random.default_rng(3), (160, 200)
    row, column = np.indices((rows, columns)) / np.reshape((rows, columns), (2, 1, 1))
    level = 0.05 + 2.4 / (1 + np.exp((row - 0.4 + 0.1 * column) / 0.07))
    light = level[..., None] * np.array(NEUTRAL)
    light[140:156, 40:160, 0] = 1.4  # a red lamp, below the limits of the other colours
    light *= (1 - 0.5 * ((row - 0.5) ** 2 + (column - 0.5) ** 2))[..., None]
    samples = np.empty((rows, columns))
    for site, (down, across) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        samples[down::2, across::2] = light[down::2, across::2, (0, 1, 1, 2)[site]]
    samples += rng.normal(0, 1, samples.shape) * np.sqrt(1e-5 * samples)
    codes, limit = BLACK + samples * (WHITE - BLACK), np.tile(np.reshape(limits, (2, 2)), (80, 100))
    clipped = codes >= limit
    codes = np.minimum(codes, limit) + noise * rng.normal(0, 1, codes.shape)
    codes[121, 61::50] = codes[130, 80::50] = WHITE  # hot pixels
    return np.rint(codes).clip(0, 65535).astype(np.uint16), clipped


@pytest.mark.parametrize("noise", [0, 6, 25])
@pytest.mark.parametrize(
    ("limits", "white"),
    [
        ((16383, 15783, 15783, 16383), WHITE),  # red and blue are multiplied
        ((14600, 15500, 15200, 16300), WHITE),
        ((15783, 15783, 15783, 15783), WHITE),
        ((16383, 15783, 15783, 16383), 15783),  # as some files state it: samples beyond, and noise
    ],
)
def test_colours_that_clip_at_codes_of_their_own_are_white_and_all_others_unchanged(
    tmp_path: Path, limits: tuple[int, ...], white: int, noise: float
) -> None:
    samples, clipped = exposed(limits, noise)
    levels = {50714: (SHORT, [BLACK]), 50717: (SHORT, [white])}
    fields = {**levels, 50728: (RATIONAL, rationals(NEUTRAL))}
    path = write_dng(tmp_path / "sky.dng", samples, fields=fields)
    scene = load_scene(path, registered=False)
    assert "clipped in the file: they are taken for white" in "".join(scene.notes)
    lost = clipped.reshape(80, 2, 100, 2).any(axis=(1, 3))
    assert 0.2 < lost.mean() < 0.8
    red, sky = colour(scene.rgb) > 0.1, np.indices(lost.shape)[0] < 65
    assert red[lost & ~sky].mean() > 0.9
    assert red[lost & sky].mean() < 0.003
    assert np.median(colour(scene.rgb)[lost & sky]) < 0.02
    far = ~maximum_filter(lost, 9)
    far &= samples.reshape(80, 2, 100, 2).max(axis=(1, 3)) < 0.9 * white
    signal = (samples - np.float32(BLACK)) / np.float32(white - BLACK)
    quads = [signal[::2, ::2], (signal[::2, 1::2] + signal[1::2, ::2]) / 2, signal[1::2, 1::2]]
    assert far.mean() > 0.1
    np.testing.assert_array_equal(scene.rgb[far], np.stack(quads, axis=2).clip(0)[far])


@pytest.mark.parametrize("spread", [60, 400])
def test_an_even_surface_that_is_the_brightest_of_its_colour_is_no_limit(spread: float) -> None:
    """It has the noise of light, or shading, and hot pixels may be above it."""
    rng = np.random.default_rng(5)
    ground, surface = rng.uniform(BLACK, 0.8 * WHITE, 50_000), rng.normal(0.9 * WHITE, spread, 5000)
    codes = np.rint(np.concatenate([ground, surface, np.full(5, WHITE)])).astype(np.uint16)
    assert saturation(codes, WHITE) == WHITE
    assert saturation(np.minimum(codes, np.uint16(0.9 * WHITE)), WHITE) == int(0.9 * WHITE)
    ramp = np.append(np.arange(3500, 3900).repeat(200), np.full(60, 3899)).astype(np.uint16)
    assert saturation(ramp, 4000) == 4000
