"""`panchroma render`: the command gives what the library gives, in every format, and a bad shot
costs one line.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import ArrayLike
from PIL import Image, ImageOps

from panchroma.offline import PRESETS, render
from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration, read_dng
from panchroma.tools.io.development import Development
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.kind import PictureKind
from panchroma.tools.simulation.sensor import simulate_additive
from tests.shared.test_white_balance import LIGHT
from tests.shared.test_white_balance import shot as coloured_light
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, results, run
from tests.tools.io.examples import encode_picture

STEM = "builtin-48x36"
MEASURED = "--bits 32 --space camera"


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A noisy shot of the built-in scene, 16 bits."""
    folder = tmp_path_factory.mktemp("shots")
    run("simulate builtin:48x36 -o", folder, "--sensor-bits 16 --sigma 0.02", code=0)
    return folder / f"{STEM}.dng"


def save(path: Path, codes: ArrayLike | None = None) -> Path:
    """A shot of these codes, of random ones without, 13 x 17."""
    samples = np.random.default_rng(0).integers(256, 3839, (13, 17), np.uint16)
    if codes is not None:
        samples[:] = codes
    metadata = CaptureMetadata(make="Contax", iso=400, orientation=6)
    sensor = CfaPattern.bayer(), SensorCalibration.of_bits(12)
    return save_mosaic(path, Mosaic(samples, *sensor, metadata))


# --- what is made --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        *((name, PictureKind.of(name)) for name in FORMATS),
        ("jpeg --quality 30", PictureKind.of("jpg", quality=30)),
        ("exr --space camera --bits 16", PictureKind.of("exr", 16, "camera")),
    ],
)
def test_the_file_is_what_the_library_writes(
    out: Path, tmp_path: Path, options: str, kind: PictureKind
) -> None:
    """Upright, with capture data; of the kind that is usual for the format, or the one that is
    asked for.
    """
    exposure = 0.0 if kind.space == "camera" else 1.0
    shot = save(tmp_path / "shot.dng")
    outcome = run("render", shot, "-o", out, f"-f {options} --exposure {exposure}", code=0)
    mosaic, path = read_dng(shot), out / f"shot{kind.suffix}"
    rendering = render(mosaic)
    development = Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata, exposure)
    picture = development.whitened(rendering.rgb, rendering.lost)
    assert path.read_bytes() == encode_picture(picture, development)
    assert results(out) == {path.name}
    rows, columns = (13, 17) if kind.space == "camera" else (17, 13)
    assert outcome.out.startswith(f"{path}: {columns} x {rows}, {kind.bits} bits, {kind.space}, ")


def uncalibrated(path: Path, level: float = 0.8) -> Path:
    """A shot of a grey scene under coloured light by a sensor that nobody has calibrated."""
    sensor = CfaPattern.bayer(6), SensorCalibration.of_bits(12)
    return save_mosaic(path, Mosaic(coloured_light(level=level).codes, *sensor))


def cast(path: Path, place: tuple[slice, ...] = ()) -> float:
    """How far the mean colour of a place of the picture is from grey."""
    mean = tifffile.imread(path)[place].mean(axis=(0, 1))
    return float(np.ptp(mean) / mean.mean())


def test_white_balance_as_shot_estimated_and_given(out: Path, tmp_path: Path) -> None:
    shot = uncalibrated(tmp_path / "a.dng")
    for balance in ("camera", "auto", ",".join(str(1 / level) for level in LIGHT)):
        options, balanced = f"--preset paper --overwrite --wb {balance}", balance != "camera"
        outcome = run("render", shot, "-o", out, options, "--json", code=0)
        assert (cast(out / "a.tif") < 0.03) == balanced, options
        assert ("white balance is unknown" in outcome.err) == (not balanced)
        assert outcome.records[0]["neutral_estimated"] == (balance == "auto")
        run("render", shot, "-o", out, "-f dng", options, code=0)
        with tifffile.TiffFile(out / "a.dng") as file:
            stated = np.array(file.pages.first.tags.valueof(50728)).reshape(3, 2)
        assert np.allclose(stated[:, 0] / stated[:, 1], LIGHT if balanced else 1, atol=0.05)


def test_a_white_balance_that_a_shot_does_not_allow(out: Path, tmp_path: Path) -> None:
    dim = uncalibrated(tmp_path / "dim.dng", level=0.004)
    refused = {"auto": ["too dark, too bright or too small"], "2.1,1": ["2 multipliers", "R, G, B"]}
    for balance, words in refused.items():
        assert_refused(run("render", dim, "-o", out, f"--wb {balance}"), *words, name=str(dim))


def colour_field(orientation: int, period: int = 6) -> Mosaic:
    """A green field with a grey square, a red one, a black one and a clipped one, all 24 pixels
    wide, under coloured light.
    """
    rgb = np.tile(np.array((0.15, 0.5, 0.1)), (120, 180, 1))
    for place, colour in ((30, 0.4), (70, (0.6, 0.1, 0.1)), (110, 0.004), (150, 3.0)):
        rgb[50:74, place : place + 24] = colour
    light = (rgb * np.array(LIGHT)).astype(np.float32)
    pattern, random = CfaPattern.bayer(period, origin=(1, 2)), np.random.default_rng(3)
    sensor = SensorCalibration.of_bits(12, headroom=False)
    codes = simulate_additive(light, pattern, sensor, 0.003, random).codes
    return Mosaic(codes, pattern, sensor, CaptureMetadata(orientation=orientation))


def seen_at(orientation: int, row: int, column: int) -> tuple[int, int]:
    """(x, y) of a pixel of `colour_field` in the picture that a viewer turns upright."""
    marks = np.zeros((120, 180), np.uint8)
    marks[row, column] = 255
    image, exif = Image.fromarray(marks), Image.Exif()
    exif[274] = orientation
    image.info["exif"] = exif.tobytes()
    y, x = np.argwhere(np.asarray(ImageOps.exif_transpose(image)))[0].tolist()
    return x, y


@pytest.mark.parametrize(("orientation", "period"), [*((turn, 6) for turn in range(1, 9)), (6, 12)])
def test_the_place_of_a_grey_is_that_in_the_picture_a_viewer_shows(
    out: Path, tmp_path: Path, orientation: int, period: int
) -> None:
    shot = save_mosaic(tmp_path / "a.dng", colour_field(orientation, period))
    grey, red = seen_at(orientation, 61, 42), seen_at(orientation, 60, 81)
    for (x, y), other in ((grey, red), (red, grey)):
        options = f"--preset paper --overwrite --wb {x},{y}"
        (record,) = run("render", shot, "-o", out, options, "--json", code=0).records
        here, there = (np.s_[y - 4 : y + 5, x - 4 : x + 5] for x, y in ((x, y), other))
        if period == 6:  # blocks 12 pixels apart do not resolve the square
            assert cast(out / "a.tif", here) < 0.04
            assert cast(out / "a.tif", there) > 0.3
        assert record["neutral_estimated"] is False
        assert (x, y) == red or record["neutral"] == pytest.approx(LIGHT, abs=0.02)


def test_a_place_that_shows_no_grey_is_refused(out: Path, tmp_path: Path) -> None:
    shot = save_mosaic(tmp_path / "a.dng", colour_field(6))
    # (130, 90) is inside the samples, but not inside the picture, which stands upright
    outside = [seen_at(6, 60, 176), (130, 90), (3, 100), (50, 0), (3, 3)]
    for x, y in [seen_at(6, 61, 122), seen_at(6, 61, 162), *outside]:
        words = f"--wb: the picture is clipped or too dark at {x},{y}; name a grey"
        if (x, y) in outside:
            words = f"--wb: the 9 x 9 pixels around {x},{y} are not all in the picture of 120 x 180"
        assert_refused(run("render", shot, "-o", out, f"--wb {x},{y}"), words, name=str(shot))


def test_all_frames_of_a_burst_have_the_neutral_of_one(out: Path, tmp_path: Path) -> None:
    """In the second the place is clipped, which is not why it is left out."""
    first = colour_field(8)
    brighter = np.minimum((first.codes.astype(float) - 256) * 9 + 256, 4095).astype(np.uint16)
    shots = save_mosaic(tmp_path / "a.dng", first), tmp_path / "b.dng"
    save_mosaic(shots[1], replace(first, samples=brighter))
    x, y = seen_at(8, 61, 42)
    line = ("burst", *shots, "-o", out, f"--overwrite --wb {x},{y} --json --reference")
    (record,) = run(*line, shots[0]).records
    assert record["neutral"] == pytest.approx(LIGHT, abs=0.02)
    assert not any("too dark" in frame["reason"] for frame in record["frames"])
    assert f"the picture is clipped or too dark at {x},{y}" in run(*line, shots[1]).err


def test_records_for_machines(out: Path, shot: Path) -> None:
    outcome = run("render -v", shot, "-o", out, "--json")
    (record,) = outcome.records
    assert record.pop("seconds") >= 0
    files = {"source": str(shot), "ok": True, "output": str(out / f"{STEM}.tif")}
    colours = {"neutral": [1.0, 1.0, 1.0], "neutral_estimated": False, "learned": "rggb-k6"}
    assert record == {**files, "width": 48, "height": 36, **colours}
    assert f"{STEM}.tif: 48 x 36" in outcome.err
    assert ": reconstructing luminance: " in outcome.err


def test_what_is_refused_before_the_work_counts_as_failed(out: Path, shot: Path) -> None:
    again = shutil.copy(shot, shot.with_suffix(".DNG"))
    outcome = run("render -n -f npy", shot, again, "-o", out, code=1)
    assert outcome.err.endswith("\n1 to be made, 1 failed\n")


def test_the_network_can_be_left_out(out: Path, shot: Path) -> None:
    for preset, network in (("best", "rggb-k6"), ("unlearned", None), ("paper", None)):
        options = f"--json --overwrite {MEASURED} --preset {preset}"
        (record,) = run("render", shot, "-o", out, options).records
        assert record["learned"] == network
        expected = render(read_dng(shot), PRESETS[preset]).rgb
        assert np.array_equal(tifffile.imread(out / f"{STEM}.tif"), expected)


def test_unknown_noise_is_said(out: Path, tmp_path: Path, shot: Path) -> None:
    words, unknown = "the noise level is unknown; calibrate", save(tmp_path / "shot.dng")
    assert words in run("render", unknown, "-o", out).err
    assert words not in run("render", shot, "-o", out, "--overwrite").err


# --- what is refused -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (256, "no sample is above the black level: nothing was exposed"),
        (4000, "every sample is saturated: there is no picture in it; expose less"),
    ],
)
def test_a_frame_without_a_picture_is_refused(
    out: Path, tmp_path: Path, code: int, words: str
) -> None:
    shot = save(tmp_path / "shot.dng", code)
    assert_refused(run("render", shot, "-o", out), words, name=str(shot))
    assert results(out) == set()


def test_colour_samples_alone_are_a_picture_for_best(out: Path, tmp_path: Path) -> None:
    """`best` takes luminance from them; the published method has none to begin with."""

    clear = CfaPattern.bayer().panchromatic_mask((13, 17))
    shot = save(tmp_path / "shot.dng", np.where(clear, 4000, 2400))
    words = "every panchromatic sample is saturated: there is no picture in it; expose less"
    assert_refused(run("render", shot, "-o", out, "--preset paper"), words, name=str(shot))
    assert results(out) == set()
    run("render", shot, "-o", out, MEASURED, code=0)
    calibration = read_dng(shot).calibration
    luminance = tifffile.imread(out / "shot.tif").astype(np.float64) @ np.array(calibration.gamma)
    channel = (2400 - calibration.black_level[0]) * calibration.scale().max()
    expected = channel * sum(calibration.gamma)
    assert abs(luminance.mean() / expected - 1) < 0.02
    assert expected > calibration.full_scale


def test_a_frame_with_one_pixel_of_light_is_a_picture(out: Path, tmp_path: Path) -> None:
    for others, one in ((256, 300), (4000, 2000)):
        light = np.full((13, 17), others)
        light[4, 4] = one
        shot = save(tmp_path / f"{one}.dng", light)
        run("render", shot, "-o", out, MEASURED, "--preset paper", code=0)
        assert np.isfinite(tifffile.imread(out / f"{one}.tif")).all()
