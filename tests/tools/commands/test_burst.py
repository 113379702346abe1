"""`panchroma burst`: frames in, one picture out; what does not fit is named, and nothing is
lost.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from panchroma.offline import PRESETS, render
from panchroma.offline.burst import merge_burst, render_burst_bands
from panchroma.shared import (
    CaptureMetadata,
    CfaPattern,
    InputError,
    Mosaic,
    SensorCalibration,
    read_dng,
)
from panchroma.tools.batch.burst_files import checked_reference
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor
from tests.tools.batch.examples import save_mosaic
from tests.tools.calibration.known_camera import stating
from tests.tools.command import Outcome, assert_refused, results, run

MEASURED = "--bits 32 --space camera --preset unlearned"
UNLEARNED = PRESETS["unlearned"]
STEM = "builtin-280x220"


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A burst of three noisy frames of the built-in scene."""
    folder = tmp_path_factory.mktemp("burst")
    options = "--burst 3 --motion 2 --sigma 0.01 --reduce 2"
    run("simulate", STEM.replace("-", ":"), "-o", folder, options, code=0)
    return folder


@pytest.fixture
def frames(taken: Path, tmp_path: Path) -> Path:
    """A copy of these frames alone, which a test may change."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for path in taken.glob("*.dng"):
        shutil.copy(path, folder)
    return folder


def frame(folder: Path, number: int) -> Path:
    return folder / f"{STEM}-{number}.dng"


def merged(frames: Path, out: Path, *options: str | Path, code: int = 0) -> Outcome:
    return run("burst", frames, "-o", out, "--preset unlearned", *options, code=code)


# --- what is made --------------------------------------------------------------------------------


def test_the_picture_is_the_librarys_and_fates_of_frames_are_told(frames: Path, out: Path) -> None:
    for number in (1, 2, 3):
        path = frame(frames, number)
        save_mosaic(path, replace(read_dng(path), metadata=CaptureMetadata(iso=100 * number)))
    paths = [str(frame(frames, number)) for number in (1, 2, 3)]
    options = (MEASURED, "--reference", paths[1], "--json")
    (record,) = run("burst", frames, "-o", out, *options, code=0).records
    assert results(out) == {f"{STEM}.tif"}
    burst = merge_burst(list(map(read_dng, paths)), UNLEARNED, reference=1)
    expected = np.concatenate(list(render_burst_bands(burst, UNLEARNED)))
    with tifffile.TiffFile(out / f"{STEM}.tif") as file:
        assert np.array_equal(file.asarray(), expected)
        # that of its reference
        assert file.pages.first.tags["ExifTag"].value["ISOSpeedRatings"] == 200
    assert (record["ok"], record["reference"], record["source"]) == (True, paths[1], paths[0])
    for fate, judged, name in zip(record["frames"], burst.frames, paths, strict=True):
        assert (fate["source"], fate["used"], fate["reason"]) == (name, True, "")
        assert (fate["down"], fate["right"]) == pytest.approx(judged.motion.shift, abs=1e-3)
        assert fate["gain"] == pytest.approx(1, abs=0.02)


def test_a_reference_is_named_by_its_path_or_by_the_name_of_its_file() -> None:
    names = ["a/1.dng", "a/2.dng", "b/2.dng"]
    assert [checked_reference(names, name, ()) for name in ("b/2.dng", "1.dng")] == [2, 0]
    with pytest.raises(InputError, match=r"`reference` 2\.dng: is none of the shots, a/1\.dng"):
        checked_reference(names, "2.dng", ())


@pytest.mark.parametrize(
    ("exposures", "told"), [((4, 2, 0.5), True), ((1, 0.6, 0.8), False), ((0.9, 0.5, 0.5), False)]
)
def test_a_reference_much_darker_than_another_frame_is_told(
    exposures: tuple[float, ...], told: bool, tmp_path: Path, out: Path
) -> None:
    """Half of the scene is clipped in the longer exposures of the bracket."""
    scene, sensor = builtin_scene(180, 130).rgb, (CfaPattern.bayer(), SensorCalibration.of_bits(14))
    shots = [tmp_path / f"step-{number}.dng" for number in (1, 2, 3)]
    for shot, exposure in zip(shots, exposures, strict=True):
        save_mosaic(shot, simulate_sensor(scene, *sensor, exposure, np.random.default_rng(0)))
    outcome = run("burst", *shots, "-o", out, "--preset unlearned", code=0)
    note = (
        f"step-3.dng is the reference, and the picture as dark: 3.0 stops darker than {shots[0]}; "
        "name that as --reference, or brighten what is shown by --exposure\n"
    )
    assert (note in outcome.err) == ("stops darker" in outcome.err) == told


# --- known shifts --------------------------------------------------------------------------------


def test_a_sensor_that_moves_to_the_right_has_a_positive_x(tmp_path: Path, out: Path) -> None:
    """Nine frames, two pixels apart: luminance and colour are known everywhere, if each frame is
    put where it was taken.
    """
    scene, sensor = builtin_scene(180, 130).rgb, (CfaPattern.bayer(), SensorCalibration.of_bits(14))
    places = [(x, y) for y in (0, 2, 4) for x in (0, 2, 4)]
    shots = [tmp_path / f"step-{number}.dng" for number in range(1, 10)]
    for shot, (x, y) in zip(shots, places, strict=True):
        light = scene[y : y + 120, x : x + 170]
        save_mosaic(shot, simulate_additive(light, *sensor, 0.0, np.random.default_rng(0)))
    shifts = " ".join(f"{x},{y}" for x, y in places)
    outcome = run("burst", *shots, "-o", out, MEASURED, "--json", "--shifts", shifts, code=0)
    assert outcome.records[0]["reference"] == str(shots[0])
    alone, truth = render(read_dng(shots[0]), UNLEARNED).rgb, scene[:120, :170]
    assert psnr(tifffile.imread(out / "step.tif"), truth) > psnr(alone, truth) + 3


# --- which frames --------------------------------------------------------------------------------


def test_what_does_not_fit_is_left_out_by_name(frames: Path, out: Path) -> None:
    shot = read_dng(frame(frames, 2))
    noise = np.random.default_rng(0).integers(300, 3800, shot.shape, np.uint16)
    turned = replace(shot, samples=shot.codes[::-1])  # no copy
    odd = {
        "has 120 x 90 pixels, the reference ": replace(shot, samples=shot.codes[:90, :120]),
        "has another filter pattern": replace(shot, pattern=CfaPattern.bayer(6, "GBRG")),
        "was taken with another camera": stating(turned, gamma=(0.9, 1.0, 1.1)),
        "": replace(shot, samples=noise),  # as sharp as any
        f"is a copy of {frame(frames, 2)}\n": replace(shot, metadata=CaptureMetadata(iso=50)),
    }
    numbered = enumerate(odd.values(), 4)
    paths = [save_mosaic(frame(frames, number), mosaic) for number, mosaic in numbered]
    outcome = merged(frames, out, "--json")
    for path, reason in zip(paths, odd, strict=True):
        assert f"{path}: is left out: {reason}" in outcome.err
    assert [fate["used"] for fate in outcome.records[0]["frames"]] == [True] * 3 + [False] * 5
    assert f"3 of 8 frames, reference {STEM}-1.dng" in outcome.err
    outcome = merged(frames, out, "--overwrite --reference", paths[4])
    assert f"{frame(frames, 2)}: is left out: is a copy of {paths[4]}\n" in outcome.err


def test_frames_of_sensors_with_other_channels_are_refused(frames: Path, out: Path) -> None:
    codes, sensor = np.full((60, 60), 9000, np.uint16), SensorCalibration(channels="RB")
    pattern = CfaPattern.of_letters("RW/WB", channels="RB")
    save_mosaic(frame(frames, 2), Mosaic(codes, pattern, sensor))
    words = "the frames are of several sensors, RB, RGB; name those of one"
    assert_refused(merged(frames, out, MEASURED, code=1), words, name=str(frame(frames, 1)))


def test_a_file_that_fails_costs_a_line_and_the_others_go_on(frames: Path, out: Path) -> None:
    cut = frame(frames, 3)
    cut.write_bytes(cut.read_bytes()[:5000])
    outcome = merged(frames, out, code=1)
    assert_refused(outcome, name=str(cut))
    assert "2 of 3 frames" in outcome.out
    assert results(out) == {f"{STEM}.tif"}
    for options in ("--dry-run --overwrite", "--resume", "--resume"):
        assert_refused(merged(frames, out, options, code=1), name=str(cut))
    outcome = merged(frames, out, "--overwrite --reference", cut, code=1)
    assert_refused(outcome, "name another --reference", name=str(cut))


# --- what is there already -----------------------------------------------------------------------


def test_a_picture_beside_its_frames_is_none_of_them(frames: Path) -> None:
    merged(frames, frames, "--format dng")
    outcome = merged(frames, frames, "--format dng --resume")
    assert f"left out {STEM}.dng named as the picture of a burst" in outcome.err
    assert "is up to date" in outcome.out
