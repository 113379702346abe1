"""`panchroma burst`: frames in, one picture out; what does not fit is named, and nothing is
lost.
"""

import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import tifffile

from panchroma.offline import PRESETS, render
from panchroma.offline.burst import merge_burst, render_burst_bands
from panchroma.shared import (
    CaptureMetadata,
    CfaPattern,
    Mosaic,
    SensorCalibration,
    read_dng,
    write_dng,
)
from panchroma.tools.evaluation.metrics import psnr
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive
from tests.tools.batch.examples import save_mosaic, save_shot
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


def merged(frames: Path, out: Path, *options: str | Path, code: int | None = 0) -> Outcome:
    return run("burst", frames, "-o", out, "--preset unlearned", *options, code=code)


# --- what is made --------------------------------------------------------------------------------


def test_the_command_gives_what_the_library_gives_and_tells_what_became_of_each_frame(
    frames: Path, out: Path
) -> None:
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


def test_dark_corners_of_a_lens_gain_as_the_middle_does(tmp_path: Path, out: Path) -> None:
    y, x, channel = np.meshgrid(np.arange(210), np.arange(280), np.arange(3), indexing="ij")
    waves = np.sin(y / 5 + channel / 2) * np.cos(x / 6 - channel / 3) * np.sin((x + y) / 17)
    np.save(tmp_path / "waves.npy", (0.25 + 0.15 * waves).astype(np.float32))
    camera = "--burst 8 --motion 3 --shading 2,15 --light 0.1 --truth"
    run("simulate", tmp_path / "waves.npy", "-o", tmp_path, camera, code=0)
    frames = sorted(tmp_path.glob("*.dng"))
    options = (MEASURED, "--reference", frames[0], "--json")
    (record,) = run("burst", *frames, "-o", out, *options, code=0).records
    assert all(fate["used"] for fate in record["frames"])
    shot, truth = read_dng(frames[0]), tifffile.imread(next(tmp_path.glob("*.truth.tif")))
    assert shot.calibration.shading is not None
    gain = shot.calibration.shading.of_plane(shot.shape)
    pictures = render(shot, UNLEARNED).rgb, tifffile.imread(next(out.glob("*.tif")))
    for low, high in pairwise(np.quantile(gain, np.linspace(0, 1, 6))):
        fifth = (gain >= low) & (gain <= high)
        alone, all_frames = (np.square((rgb - truth)[fifth]).mean() ** 0.5 for rgb in pictures)
        assert all_frames < alone / 1.3


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


OTHER = CfaPattern.bayer(6, "GBRG")
LEFT_OUT: dict[str, Callable[[Mosaic], Mosaic]] = {
    "has 120 x 90 pixels, the reference ": lambda shot: replace(
        shot, samples=shot.codes[:90, :120]
    ),
    "has another filter pattern": lambda shot: replace(shot, pattern=OTHER),
    "was taken with another camera": lambda shot: stating(shot, gamma=(0.9, 1.0, 1.1)),
}


@pytest.mark.parametrize("reason", LEFT_OUT)
def test_a_frame_that_does_not_fit_is_left_out_by_name(
    frames: Path, out: Path, reason: str, tmp_path: Path
) -> None:
    odd = save_mosaic(frame(frames, 2), LEFT_OUT[reason](read_dng(frame(frames, 2))))
    outcome = merged(frames, out, "--json")
    assert f"{odd}: is left out: {reason}" in outcome.err
    assert [fate["used"] for fate in outcome.records[0]["frames"]] == [True, False, True]
    # Now the others are odd.
    outcome = merged(frames, out, "--reference", odd, "--overwrite")
    assert outcome.err.count(": is left out: ") == 2
    assert f"1 of 3 frames, reference {odd.name}" in outcome.out
    run("render", odd, "-o", tmp_path / "one", "--preset", "unlearned", code=0)
    assert (out / f"{STEM}.tif").read_bytes() == (tmp_path / "one" / f"{STEM}-2.tif").read_bytes()


def test_copies_and_frames_of_another_scene_are_left_out_by_name(frames: Path, out: Path) -> None:
    original = read_dng(frame(frames, 2))
    noise = np.random.default_rng(0).integers(300, 3800, original.shape, np.uint16)
    odd = save_mosaic(frame(frames, 4), replace(original, samples=noise))  # as sharp as any
    copied = replace(original, metadata=CaptureMetadata(iso=50))
    write_dng(copy := frame(frames, 5), copied, np.ones((8, 8, 3), np.uint8))  # another preview
    outcome = merged(frames, out)
    assert re.findall(r"([^/ ]+): is left out: ", outcome.err) == [odd.name, copy.name]
    assert f"{copy}: is left out: is a copy of {frame(frames, 2)}\n" in outcome.err
    assert f"3 of 5 frames, reference {STEM}-1.dng" in outcome.out
    outcome = merged(frames, out, "--overwrite", "--reference", copy)
    assert f"{frame(frames, 2)}: is left out: is a copy of {copy}\n" in outcome.err


def test_frames_of_sensors_with_other_channels_are_refused(frames: Path, out: Path) -> None:
    pattern, sensor = (
        CfaPattern.of_letters("RW/WB", channels="RB"),
        SensorCalibration(channels="RB"),
    )
    save_mosaic(frame(frames, 2), Mosaic(np.full((60, 60), 9000, np.uint16), pattern, sensor))
    words = "the frames are of several sensors, RB, RGB; name those of one"
    assert_refused(merged(frames, out, MEASURED, code=1), words, name=str(frame(frames, 1)))


def test_a_file_that_fails_costs_a_line_and_the_others_go_on(frames: Path, out: Path) -> None:
    cut = frame(frames, 3)
    cut.write_bytes(cut.read_bytes()[:5000])
    outcome = merged(frames, out, code=1)
    assert_refused(outcome, name=str(cut))
    assert "2 of 3 frames" in outcome.out
    assert results(out) == {f"{STEM}.tif"}
    assert_refused(merged(frames, out, "--dry-run --overwrite", code=1), name=str(cut))
    outcome = merged(frames, out, "--overwrite --reference", cut, code=1)
    assert_refused(outcome, "name another --reference", name=str(cut))


# --- what is there already -----------------------------------------------------------------------


def test_a_finished_burst_is_not_made_again(frames: Path, out: Path) -> None:
    def is_current(*options: str | Path) -> bool:
        planned = merged(frames, out, "--resume --json --dry-run", *options)
        return bool(planned.records[0].get("current"))

    picture = out / f"{STEM}.tif"
    merged(frames, out)
    assert is_current()
    assert not is_current("--reference", frame(frames, 2))
    picture.write_text("edited")
    save_shot(frame(frames, 4), shape=(60, 70))
    merged(frames, out, "--resume")
    assert (out / f"{picture.name}.bak").read_text() == "edited"
