"""`import panchroma`: the same results as the commands and the libraries, shown, and errors that
say what is wrong.
"""

import io
import json
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import imagecodecs
import numpy as np
import pytest
from PIL import Image

import panchroma
from panchroma.shared import (
    Camera,
    CaptureMetadata,
    CfaPattern,
    InputError,
    Mosaic,
    SensorCalibration,
    Shading,
)
from panchroma.tools.cli import spelled
from panchroma.tools.io.colour import decode_srgb
from panchroma.tools.io.kind import PictureKind
from panchroma.tools.simulation.lens import lens_shading
from tests.tools.command import repeated, run


class Pipe(io.BytesIO):
    """As the other end of a pipe, or of a connection."""

    def seekable(self) -> bool:
        return False


SCENE = "builtin:96x72"
RNG = np.random.default_rng(0)
GREY = np.full((48, 48, 3), 0.5, np.float32)
FOUR = "ABWWWW/CDWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"
BROADBAND = FOUR.replace("AB", "CM").replace("CDW", "YCW")


@pytest.fixture(scope="module")
def shot() -> panchroma.Shot:
    return panchroma.simulate(SCENE, sigma=0.01)


def pixels(path: Path) -> np.ndarray[Any, Any]:
    return np.asarray(Image.open(path))


def shown(result: Any) -> np.ndarray[Any, Any]:
    """The picture that a notebook shows."""
    return np.asarray(imagecodecs.png_decode(result._repr_png_()))


def test_files_and_screens_show_what_the_command_writes(
    shot: panchroma.Shot, tmp_path: Path
) -> None:
    shot.save(tmp_path / "shot.dng")
    run("render -f png", tmp_path / "shot.dng", "-o", tmp_path, code=0)
    run("preview --scale 2", tmp_path / "shot.dng", "-o", tmp_path, code=0)
    read = panchroma.open(tmp_path / "shot.dng")
    picture = panchroma.render(tmp_path / "shot.dng")
    picture.save(tmp_path / "mine.png")
    panchroma.preview(read, scale=2).save(tmp_path / "mine.jpg")
    assert (tmp_path / "mine.png").read_bytes() == (tmp_path / "shot.png").read_bytes()
    mine, made, png = (pixels(tmp_path / name) for name in ("mine.jpg", "shot.jpg", "mine.png"))
    assert np.array_equal(mine, made)
    assert np.array_equal(panchroma.to_srgb(picture), png)
    assert np.array_equal(read.mosaic.codes, shot.mosaic.codes)


def test_arrays_are_scenes_as_files_are(tmp_path: Path) -> None:
    pixels = RNG.integers(0, 256, (24, 30, 3), np.uint8)
    panchroma.Image(pixels).save(tmp_path / "scene.png")
    of_file, of_array = panchroma.simulate(tmp_path / "scene.png"), panchroma.simulate(pixels)
    difference = of_file.mosaic.codes.astype(int) - of_array.mosaic.codes
    assert np.abs(difference).max() <= 1  # the file's profile samples the curve of sRGB
    assert of_array.truth.rgb == pytest.approx(decode_srgb(pixels / np.float32(255)), abs=1e-6)
    assert np.array_equal(panchroma.simulate(of_array.truth).mosaic.codes, of_array.mosaic.codes)
    coloured, grey = (panchroma.simulate(array) for array in (GREY, GREY[..., 0]))
    assert np.array_equal(grey.mosaic.codes, coloured.mosaic.codes)


@pytest.mark.parametrize("pattern", [4, "RG/BW", "WBWG/BWGW/WGWR/GWRW", CfaPattern.bayer(8), FOUR])
def test_any_pattern_and_channels_become_a_picture_that_shows_itself(pattern: Any) -> None:
    scene = RNG.random((48, 54, 4 if pattern == FOUR else 3), np.float32)
    shot = panchroma.simulate(scene, pattern=pattern, light=0.5)
    picture = panchroma.render(shot, preset="paper")
    assert picture.channels == shot.pattern.channels
    assert picture.rgb.shape == (48, 54, len(picture.channels))
    assert shown(picture).shape == shown(shot).shape == (48, 54, 3)


def test_channels_may_be_named_and_in_another_order_than_the_patterns() -> None:
    scene = RNG.random((24, 24, 4), np.float32)
    plain = panchroma.simulate(scene, pattern=FOUR)
    named = panchroma.simulate(scene[..., ::-1], pattern=FOUR, bands="DCBA")
    assert np.array_equal(plain.mosaic.codes, named.mosaic.codes)
    kept = panchroma.simulate(scene, pattern=FOUR.replace("ABW", "RGW"), bands="RGCD")
    assert np.array_equal(kept.truth.rgb, scene)
    coloured = panchroma.simulate(scene, bands="RGBN")
    assert np.array_equal(coloured.mosaic.codes, panchroma.simulate(scene[..., :3]).mosaic.codes)


def test_noise_comes_from_a_seed_a_generator_or_anew() -> None:
    generator = np.random.default_rng(7)
    origins = 7, np.random.SeedSequence(7), generator, generator, None, None
    codes = [panchroma.simulate(GREY, sigma=0.1, rng=rng).mosaic.codes for rng in origins]
    assert np.array_equal(codes[0], codes[1])
    assert np.array_equal(codes[0], codes[2])
    assert all(not np.array_equal(codes[n], codes[n + 1]) for n in (2, 3, 4))


def test_a_burst_is_that_of_the_command(tmp_path: Path) -> None:
    options: Any = {"pattern": BROADBAND, "bracket": (0, -1, 1), "reduce": 2, "origin": (1, 2)}
    shots = panchroma.simulate(SCENE, burst=3, **options)
    line = f"--pattern {BROADBAND} --burst 3 --bracket 0,-1,1 --reduce 2 --origin 1,2"
    run("simulate", SCENE, "-o", tmp_path, line, code=0)
    for number, shot in enumerate(shots, 1):
        same = panchroma.open(tmp_path / f"builtin-96x72-{number}.dng").mosaic
        assert np.array_equal(same.codes, shot.mosaic.codes)
        assert (same.pattern, same.metadata) == (shot.pattern, shot.metadata)
        assert same.calibration == shot.calibration
    assert [shot.truth.white for shot in shots] == [1, 0.5, 2]
    moved = panchroma.simulate(SCENE, burst=2, motion=5, rng=3)
    assert moved[0].shape == moved[1].shape
    assert not np.array_equal(moved[0].mosaic.codes, moved[1].mosaic.codes)


@pytest.mark.parametrize(
    ("line", "options"),
    [
        ("--wb 2,1,1", {"wb": (2, 1, 1)}),
        ("--reference s-2.dng --preset unlearned", {"reference": 1, "preset": "unlearned"}),
        ("--shifts 0,0:2,0:0,2", {"shifts": [(0, 0), (2, 0), (0, 2)]}),
    ],
)
def test_a_merged_burst_is_that_of_the_command(
    line: str, options: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    taken = panchroma.simulate("builtin:108x90", burst=3, motion=2, light=1, bracket=(-1, -1, 0))
    names = [f"s-{number}.dng" for number in (1, 2, 3)]
    for name, shot in zip(names, taken, strict=True):
        shot.save(name)
    words = [word.replace(":", " ") for word in line.split()]
    command: tuple[str | Path, ...] = ("burst", *names, "-o", "out", "--json", *map(Path, words))
    (record,) = run(*command, code=0).records
    of_files = panchroma.burst(names, **options)
    of_folder, of_shots = panchroma.burst(tmp_path, **options), panchroma.burst(taken, **options)
    for picture in (of_files, of_folder, of_shots):
        picture.save("mine.tif", overwrite=True)
        assert Path("mine.tif").read_bytes() == Path("out/s.tif").read_bytes()
    assert of_files.facts == {key: record[key] for key in ("reference", "frames")}
    chosen = int(of_shots.facts["reference"][6])
    assert of_shots.white == taken[chosen].truth.white


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Charts, dark and flat frames, of a lens with shading."""
    folder = tmp_path_factory.mktemp("bench")
    lights = {"chart": ("chart:360x240", 1.0), "dark": ("dark:360x240", 1.0)}
    lights |= {f"flat{level}": ("flat:360x240", level) for level in (0.2, 0.8)}
    for name, (scene, light) in lights.items():
        for seed in (1, 2):
            taken = panchroma.simulate(scene, light=light, rng=seed, shading=(0.5, 5))
            taken.save(folder / f"{name}-{seed}.dng")
    return folder


@pytest.mark.parametrize("kinds", [("chart",), ("dark", "flat"), ("chart", "dark", "flat")])
def test_a_calibration_is_that_of_the_command(
    kinds: tuple[str, ...], bench: Path, tmp_path: Path
) -> None:
    files: dict[str, Any] = {kind: sorted(map(str, bench.glob(f"{kind}*"))) for kind in kinds}
    line = [*files.pop("chart", ())]
    found = panchroma.calibrate(line, **files)
    of_shots: dict[str, Any] = {
        kind: list(map(panchroma.open, names)) for kind, names in files.items()
    }
    same = panchroma.calibrate(list(map(panchroma.open, line)), **of_shots)
    for kind, names in files.items():
        line += repeated(f"--{kind}", names)
    camera, mine, made = (tmp_path / name for name in ("camera.json", "mine.json", "made"))
    record = run("calibrate", *line, "-o", camera, "--json", code=0).records[-1]
    found.save(mine, report=made)
    assert mine.read_bytes() == camera.read_bytes()
    assert found.verdict == record["verdict"]
    warnings = [spelled(text, ["--dark", "--flat", "--update"]) for text in found.warnings]
    assert warnings == record["warnings"]
    assert found.facts == found.camera.measured
    assert found.verdict.capitalize() in (made / "report.html").read_text("utf-8")
    one, other = (replace(each.camera.calibration, camera="") for each in (same, found))
    assert one == other
    more = panchroma.calibrate(dark=bench / "dark-1.dng", update=mine)
    more.save(mine, overwrite=True)
    run("calibrate --dark", bench / "dark-1.dng", "-o", camera, "--update --overwrite", code=0)
    assert mine.read_bytes() == camera.read_bytes()
    assert set(more.facts) == {"black_level", "defects"}
    assert more.camera.measured.keys() == found.camera.measured.keys() | more.facts.keys()


def test_the_white_balance_changes_what_is_shown_alone(shot: panchroma.Shot) -> None:
    plain, warm = (panchroma.render(shot, wb=wb) for wb in ("camera", (2, 1, 1)))
    assert np.array_equal(plain.rgb, warm.rgb)
    assert shown(warm)[..., 0].mean() > shown(plain)[..., 0].mean() + 5


def test_pictures_and_arrays_of_any_channels_are_compared_alike() -> None:
    truth = panchroma.simulate(RNG.random((60, 60, 4), np.float32), pattern=FOUR).truth
    noisy = truth.rgb + RNG.normal(0, 0.01, truth.rgb.shape).astype(np.float32)
    figures = panchroma.compare(noisy, truth)
    assert figures == panchroma.compare(noisy, truth.rgb)
    assert figures == panchroma.compare(replace(truth, rgb=noisy), truth)
    assert figures.wrong_hue is None
    assert figures.psnr[0] == pytest.approx(40, abs=0.2)


def test_figures_fall_with_the_light() -> None:
    """White as exposed is the peak of every figure, however truth and picture come."""
    ours = []
    for light in (1.0, 1 / 4, 1 / 16):
        shot = panchroma.simulate("builtin:120x90", light=light)
        picture = panchroma.render(shot, preset="paper")
        figures = panchroma.compare(picture, shot)
        assert figures == panchroma.compare(picture.rgb, shot.truth)
        assert figures == panchroma.compare(picture, shot.truth.rgb)
        assert figures == panchroma.compare(picture.rgb, shot.truth.rgb, white=light)
        ours.append((figures.median, figures.psnr))
    assert ours[0] > ours[1] > ours[2]
    again = panchroma.simulate(shot.truth)  # its white is as dark as it
    assert again.truth.white == light


def test_floating_point_has_no_white_level_and_so_no_saturation() -> None:
    light, pattern = np.full((48, 60), 30.0), CfaPattern.bayer(6)
    shot = panchroma.Shot(Mosaic(light, pattern, SensorCalibration.of_bits(12)))
    assert panchroma.render(shot, preset="paper").rgb.mean() == pytest.approx(10, rel=0.5)


def test_a_chart_under_two_lights_says_that_it_is_one_shot() -> None:
    chart = panchroma.simulate("chart:480x360", light=1)
    with pytest.raises(InputError, match=r"no chart .* under the light D65; .*the same shot as"):
        panchroma.calibrate(chart_light={"A": chart, "D65": chart})


def test_a_note_is_logged_once_in_a_run(caplog: pytest.LogCaptureFixture) -> None:
    bright = np.full((48, 48, 3), 7.125, np.float32)
    shots = [panchroma.simulate(bright, sigma=sigma) for sigma in (0.0, 0.01, 0.02)]
    assert caplog.text.count("the brightest value is 7.125") == 1
    assert all("the brightest value is 7.125" in shot.notes[0] for shot in shots)


@pytest.mark.parametrize("format", ["png", "uhdr"])
def test_small_highlights_are_white_as_the_command_shows_them(format: str, tmp_path: Path) -> None:  # noqa: A002
    """One of these formats is written band by band, the frame is higher than a band, and it is
    turned.
    """
    wall = np.full((300, 60, 3), 0.02)
    for row in range(9, 300, 6):  # so that some lie between the blocks
        wall[row : row + 3, 30:33] = 1
    shot = panchroma.simulate(wall, light=20)
    shot = replace(shot, mosaic=replace(shot.mosaic, metadata=CaptureMetadata(orientation=6)))
    shot.save(tmp_path / "wall.dng")
    run("render", tmp_path / "wall.dng", "-o", tmp_path, f"-f {format} --exposure -3", code=0)
    picture = panchroma.render(tmp_path / "wall.dng")
    assert picture.lost is not None
    written = tmp_path / f"wall{PictureKind.of(format).suffix}"
    mine = tmp_path / f"mine{written.suffix}"
    picture.save(mine, format=format, exposure=-3)
    assert mine.read_bytes() == written.read_bytes()
    white, bare = (
        np.sum(np.asarray(panchroma.to_srgb(image, exposure=-3)).min(axis=2) >= 250)
        for image in (picture, replace(picture, lost=None))
    )
    assert white > 300 > bare


def test_more_memory_than_may_be_used_is_refused(shot: panchroma.Shot) -> None:
    message = r'96 x 72 pixels as npy need .*, 1 MB are allowed; set `max_memory="\d+M"`'
    for most in (1 << 20, "1M"):
        with pytest.raises(panchroma.PanchromaError, match=message):
            panchroma.render(shot, max_memory=most)
    with pytest.raises(panchroma.PanchromaError, match=f"2 frames of {message}"):
        panchroma.burst([shot, shot], max_memory="1M")


def test_a_shot_at_another_focal_length_has_a_note(shot: panchroma.Shot, tmp_path: Path) -> None:
    shading = Shading((((1.0,) * 4,) * 4,) * 4, shot.shape, focal_length=35)
    calibration = replace(shot.calibration, shading=shading)
    metadata = CaptureMetadata(focal_length=50.0)
    zoomed = panchroma.Shot(replace(shot.mosaic, calibration=calibration, metadata=metadata))
    zoomed.save(tmp_path / "zoomed.dng")
    (note,) = panchroma.open(tmp_path / "zoomed.dng").notes
    assert note.startswith("taken at 50 mm, but its shading was")


def test_what_is_shown_is_upright(shot: panchroma.Shot) -> None:
    turned = replace(shot, mosaic=replace(shot.mosaic, metadata=CaptureMetadata(orientation=6)))
    assert shown(turned).shape == (96, 72, 3)
    assert np.array_equal(shown(turned), shown(shot).transpose(1, 0, 2)[:, ::-1])
    assert panchroma.to_srgb(panchroma.render(turned, preset="paper")).shape == (96, 72)


def test_large_pictures_are_shown_small() -> None:
    stripes = np.zeros((1500, 2100, 3), np.uint8)
    stripes[:, ::3] = 240
    assert shown(panchroma.Image(stripes)).shape == (500, 700, 3)
    assert (shown(panchroma.Image(stripes)) == 80).all()
    assert shown(panchroma.Picture(np.zeros((1, 3000, 3), np.float32))).shape == (1, 3000, 3)
    white = np.ones(stripes.shape, np.float32)
    assert shown(panchroma.Picture(white, lost=stripes[..., 0])).shape == (500, 700, 3)


def test_a_camera_file_replaces_the_calibration(shot: panchroma.Shot, tmp_path: Path) -> None:
    camera = Camera(SensorCalibration.of_bits(12, gamma=(0.9, 1.1, 0.8)), CfaPattern.bayer(4))
    (tmp_path / "camera.json").write_text(json.dumps(camera.to_json()))
    made = panchroma.simulate(SCENE, camera=tmp_path / "camera.json")
    assert (made.pattern, made.calibration.gamma) == (camera.pattern, (0.9, 1.1, 0.8))
    shot.save(tmp_path / "shot.dng")
    with pytest.raises(panchroma.PanchromaError, match="different sensors"):
        panchroma.open(tmp_path / "shot.dng", camera=tmp_path / "camera.json")


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda: panchroma.simulate("there.tif", bands="BGR"), "`bands` is 'BGR'"),
        (lambda: panchroma.simulate(GREY, bands="RGBW"), "`bands` is 'RGBW'; each channel has a"),
        (lambda: panchroma.simulate(GREY, bands="RGG"), "`bands` is 'RGG'; each channel has a"),
        (lambda: panchroma.simulate(GREY, origin=(1.5, 2)), "`origin` is 1.5, expected a whole"),  # type: ignore[arg-type]
        (lambda: panchroma.simulate(GREY, origin="12"), "expected two whole numbers"),  # type: ignore[call-overload]
        (lambda: panchroma.render(GREY), "ndarray is neither a shot nor its file; Shot(Mosaic("),  # type: ignore[arg-type]
        (lambda: panchroma.simulate(GREY, pattern=6.0), "'K=6.0': is not"),  # type: ignore[call-overload]
        (lambda: panchroma.simulate(GREY, rng=-1), "`rng` is -1"),
        (lambda: panchroma.simulate([[1, 2], [3]]), "the array is object"),
        (lambda: panchroma.to_srgb(panchroma.Picture(GREY), exposure=-200), "expected -16 to 16"),
        (lambda: panchroma.simulate(np.ma.masked_less(GREY, 1)), "masked values; fill them"),
        (lambda: panchroma.Picture(np.ma.masked_less(GREY, 1)), "masked values; fill them"),
        (lambda: panchroma.compare(GREY, np.ma.masked_less(GREY, 1)), "masked values; fill them"),
        (lambda: panchroma.Picture(GREY, lost=np.zeros((4, 5), np.uint8)), "uint8 (48, 48)"),
        (lambda: panchroma.Picture(GREY).save("picture.png", format="tif"), "ends in .tif"),
        (lambda: panchroma.Picture(GREY, white=np.nan), "`white` is nan"),
        (lambda: panchroma.render(panchroma.Shot(GREY)), "a shot holds a Mosaic"),  # type: ignore[arg-type]
        (lambda: panchroma.open("shot.dng").save("shot.dng"), "overwrite=True"),
        (lambda: panchroma.simulate(panchroma.open("shot.dng")), "the array is object"),  # type: ignore[call-overload]
        (lambda: panchroma.compare(panchroma.open("shot.dng"), GREY), "of shape ()"),  # type: ignore[arg-type]
        (lambda: panchroma.compare(GREY, panchroma.open("shot.dng")), "truth"),
        (lambda: panchroma.compare(GREY, GREY, white=0), "`white` is 0"),
        (lambda: panchroma.burst("nowhere.dng"), "no such file"),
        (panchroma.calibrate, "nothing to calibrate from"),
        (lambda: panchroma.calibrate("shot.dng"), "skipped shot.dng: no ColorChecker"),
        (lambda: panchroma.calibrate("empty"), "empty: no .dng file"),
        (lambda: panchroma.calibrate("shot.dng", corners=[(0, 0)]), "expected four (x, y)"),
        (lambda: panchroma.calibrate("shot.dng", corners=[1, 2, 3, 4]), "expected four (x, y)"),  # type: ignore[list-item]
        (lambda: panchroma.calibrate("shot.dng", update="there.tif"), "there.tif: "),
        (lambda: panchroma.burst([]), "`shots` is empty"),
        (lambda: panchroma.burst(panchroma.open("shot.dng")), "shots[0]: is one frame"),
        (lambda: panchroma.burst([panchroma.open("shot.dng"), "gone.dng"]), "gone.dng: there is"),
        (lambda: panchroma.burst(["shot.dng"] * 2, shifts=[1, 2]), "(right, down) of each"),  # type: ignore[list-item]
        (lambda: panchroma.burst(["shot.dng", "x.dng"], shifts=[(0, 0)]), "places for 1 of 2"),
        (lambda: panchroma.burst(["shot.dng", "x.dng"], reference=2), "expected 0 to 1"),
        (lambda: panchroma.compare(np.asarray(panchroma.to_srgb(GREY)), GREY), "uint8"),
        (lambda: panchroma.open(io.BytesIO(b"GIF89a")), "the file object: not a DNG"),
        (lambda: panchroma.open(io.StringIO("II*")), "a file is StringIO, expected its name"),  # type: ignore[arg-type]
        (lambda: panchroma.open(3), "a file is int, expected its name"),  # type: ignore[arg-type]
        (lambda: panchroma.simulate(io.BytesIO(b"GIF89a")), "the file object: "),
        (lambda: panchroma.simulate(Pipe(b"II*\0")), "cannot be read from its beginning; give io"),
        (lambda: panchroma.open(Pipe(b"II*\0")), "cannot be read from its beginning; give io"),
        (lambda: panchroma.Picture(GREY).save(io.BytesIO()), "unknown picture format ''"),
        (lambda: panchroma.to_srgb(GREY).save(io.BytesIO()), "saved as .png or .jpg"),
        (lambda: panchroma.to_srgb(GREY).save("a.png", format="jpg"), "'png' by its name"),
        (lambda: panchroma.Picture(GREY).save(io.StringIO(), format="tif"), "a file is StringIO"),  # type: ignore[arg-type]
    ],
)
def test_an_error_names_what_is_wrong(
    wrong: Callable[[], object],
    said: str,
    shot: panchroma.Shot,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    shot.save("shot.dng")
    Path("there.tif").touch()
    Path("empty").mkdir()
    with pytest.raises(panchroma.PanchromaError) as caught:
        wrong()
    assert said in str(caught.value)


def test_a_name_that_there_is_not_is_an_error_of_types_and_says_which_there_are() -> None:
    """mypy refuses an `ignore` that it does not need (`tests/test_types.py`)."""
    with pytest.raises(AttributeError, match=r"has no 'nonsense'; it has .*, render, simulate"):
        panchroma.nonsense  # type: ignore[attr-defined]  # noqa: B018
    assert not hasattr(panchroma, "evaluate")


def test_files_are_file_objects_too(shot: panchroma.Shot, tmp_path: Path) -> None:
    """What they hold is what the files hold, wherever they stand; they stay open."""
    camera, dark = tmp_path / "camera.json", tmp_path / "dark.dng"
    panchroma.simulate("dark:96x72", light=1).save(dark)
    measured = panchroma.calibrate(dark=dark)
    written: dict[str, tuple[Any, dict[str, Any]]] = {
        "a.dng": (shot, {}),
        "a.jpg": (panchroma.preview(shot), {"format": "jpg"}),
        "a.png": (panchroma.preview(shot), {"format": "png"}),
        "camera.json": (measured, {}),
        **{f"b.{kind}": (shot.truth, {"format": kind}) for kind in ("tif", "png", "exr", "npy")},
        **{f"c.{kind}": (shot.truth, {"format": kind}) for kind in ("dng", "jxl", "jpeg")},
    }
    for name, (result, options) in written.items():
        held = io.BytesIO()
        result.save(held, **options)
        result.save(tmp_path / name)
        with pytest.raises(TypeError, match="`overwrite` is 'no', expected True or False"):
            result.save(tmp_path / name, overwrite="no")
        assert held.getvalue() == (tmp_path / name).read_bytes(), name
        with (tmp_path / f"again-{name}").open("wb") as named:  # whose name says the format
            result.save(named)
        assert (tmp_path / f"again-{name}").read_bytes() == held.getvalue(), name
        if result is shot.truth and name != "c.jxl":
            one, other = (panchroma.simulate(file).mosaic for file in (held, tmp_path / name))
            assert np.array_equal(one.codes, other.codes)
    held = io.BytesIO((tmp_path / "a.dng").read_bytes())
    assert np.array_equal(panchroma.open(held).mosaic.codes, shot.mosaic.codes)
    with camera.open("rb") as stated:
        seen = panchroma.open(held, camera=stated).calibration
        assert seen == panchroma.open(tmp_path / "a.dng", camera=camera).calibration
        assert panchroma.simulate(SCENE, camera=stated).calibration.camera == seen.camera
    with tempfile.TemporaryFile() as unnamed:
        shot.save(unnamed)
        assert np.array_equal(panchroma.open(unnamed).mosaic.codes, shot.mosaic.codes)
    assert np.array_equal(panchroma.preview(held), panchroma.preview(tmp_path / "a.dng"))
    two = [shot, replace(shot, mosaic=panchroma.simulate(SCENE, sigma=0.01, rng=1).mosaic)]
    files = [tmp_path / "a.dng", tmp_path / "d.dng"]
    two[1].save(files[1])
    objects = [io.BytesIO(path.read_bytes()) for path in files]
    assert np.array_equal(panchroma.burst(objects).rgb, panchroma.burst(files).rgb)
    assert panchroma.calibrate(dark=io.BytesIO(dark.read_bytes())).camera == measured.camera


def test_a_lens_is_simulated_and_known() -> None:
    shot = panchroma.simulate("builtin:120x90", shading=(1.5, 10), light=1)
    assert shot.mosaic.calibration.shading == lens_shading(1.5, 0.1, 4, (90, 120))


def test_programs_to_which_underflow_is_an_error_are_served(tmp_path: Path) -> None:
    with np.errstate(all="raise"):
        frames = panchroma.simulate("builtin:280x220", burst=3, motion=3, bracket=(0, -2, 2))
        panchroma.burst(frames).save(tmp_path / "a.exr")
        panchroma.render(frames[0]).save(tmp_path / "b.exr")
