"""`panchroma simulate`: scenes become shots, every option counts, and what is no scene costs one line."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

import panchroma
from panchroma.shared import CfaPattern, NoiseModel, SensorCalibration, read_camera, read_dng
from panchroma.tools.commands.simulate import noise_of
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.burst import SimulatedBurst, burst_frames
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor, typical_noise
from tests.tools.command import assert_refused, names, run

SOURCE = "builtin:24x18"
SHOT, TRUTH, SHOWN = (f"builtin-24x18.{ending}" for ending in ("dng", "truth.tif", "truth.png"))


def camera(bits: int = 12, **fields: Any) -> SensorCalibration:
    """What the command takes without --camera, for the built-in scene."""
    scene = builtin_scene(24, 18)
    given = {"camera_to_xyz": scene.camera_to_xyz, "neutral": scene.neutral, "sensor": "simulated"}
    return SensorCalibration.of_bits(bits, **{**given, **fields})


def simulate(out: Path, *options: str | Path) -> Any:
    """The shot of the built-in scene that is made with `options`."""
    run("simulate", SOURCE, "-o", out, "--overwrite", *options, code=0)
    return read_dng(out / SHOT)


# --- what is made ---------------------------------------------------------------------------------------------------------------


def test_a_shot_is_the_forward_model_of_the_scene(out: Path) -> None:
    scene = builtin_scene(24, 18).rgb
    expected = simulate_additive(scene, CfaPattern.bayer(), camera(), 0.02, noise_of(7, SHOT))
    shot, truth = simulate(out, "--sigma", "0.02", "--seed", "7", "--truth"), tifffile.imread(out / TRUTH)
    assert np.array_equal(shot.codes, expected.codes)
    assert (shot.pattern, shot.calibration) == (expected.pattern, expected.calibration)
    assert names(out) == {SHOT, TRUTH, SHOWN}
    assert truth.dtype == np.float32
    assert np.array_equal(truth, scene)


@pytest.mark.parametrize("named", [(), ("--light", "1")])
def test_the_sensor_protocol_clips_and_counts_photons(out: Path, named: tuple[str, ...]) -> None:
    calibration = camera(white_level=4095)  # the sensor ends where its codes do
    expected = simulate_sensor(builtin_scene(24, 18).rgb, CfaPattern.bayer(), calibration, 4.0, noise_of(0, SHOT))
    shot = simulate(out, *named, "--light", "4")
    assert np.array_equal(shot.codes, expected.codes)
    assert shot.calibration.noise == typical_noise(calibration)
    assert shot.codes.max() == 4095


@pytest.mark.parametrize(
    ("options", "reads"),
    [
        (["--pattern", "K=5"], lambda shot: shot.pattern == CfaPattern.bayer(5)),
        (["--pattern", "GBW/RGW/WWW"], lambda shot: shot.pattern == CfaPattern.bayer(3, "GBRG")),
        (["--origin", "4,-1"], lambda shot: shot.pattern == CfaPattern.bayer(6, origin=(4, 5))),
        (["--bits", "10"], lambda shot: (shot.calibration.bits, shot.calibration.white_level) == (10, 959)),
        (["--bits", "16"], lambda shot: (shot.calibration.bits, shot.calibration.black_level[0]) == (16, 4096)),
        (["--sigma", "0.05"], lambda shot: shot.calibration.noise == NoiseModel.gaussian(0.05, 4)),
    ],
)
def test_every_option_of_the_camera_counts(out: Path, options: list[str], reads: Callable[[Any], bool]) -> None:
    plain = simulate(out)
    before = (out / SHOT).read_bytes()
    assert reads(simulate(out, *options))
    assert (out / SHOT).read_bytes() != before
    assert not reads(plain)


def test_shots_of_one_command_have_noise_of_their_own_in_any_order(out: Path, tmp_path: Path) -> None:
    """Two flat frames with the same noise would measure no noise at all."""
    sources = [tmp_path / "flat1.npy", tmp_path / "flat2.npy"]
    for source in sources:
        np.save(source, np.full((36, 36, 3), 0.5, np.float32))
    white = CfaPattern.bayer().panchromatic_mask((36, 36))
    for protocol in (["--sigma", "0.1"], ["--light", "1"]):
        run("simulate", *sources, "-o", out, "--overwrite", *protocol, code=0)
        one, other = (read_dng(out / f"{source.stem}.dng").codes.astype(float) for source in sources)
        assert abs(np.corrcoef(one[white], other[white])[0, 1]) < 0.2
        run("simulate", *reversed(sources), "-o", out, "--overwrite", *protocol, code=0)
        assert np.array_equal(read_dng(out / "flat1.dng").codes, one)


@pytest.mark.parametrize("light", [0.25, 1, 3])
@pytest.mark.parametrize(
    "more", [(), ("--shading", "1,10"), ("--reduce", "2"), ("--burst", "2", "--motion", "1", "--bracket=1,-1")]
)
def test_the_truth_is_as_bright_as_a_render_under_any_light(out: Path, more: tuple[str, ...], light: float) -> None:
    """It is the light of the scene times light and exposure, in command and notebook, in each protocol."""
    options = ("--truth", *more)
    run("simulate", "builtin:96x72", "-o", out, "--light", str(light), *options, code=0)
    name = "builtin-96x72"
    found = tifffile.imread(out / f"{name}.truth.tif")
    run("simulate", "builtin:96x72", "-o", out, "--overwrite", "--truth", *more, code=0)
    exposure = 2 if "--burst" in more else 1
    plain = tifffile.imread(out / f"{name}.truth.tif") / exposure
    np.testing.assert_allclose(found, plain * light * exposure, rtol=1e-6)
    if not more:
        shot = panchroma.simulate("builtin:96x72", light=light)
        np.testing.assert_array_equal(shot.truth.rgb, found)
        assert shot.truth.white == light


def test_a_camera_file_gives_gamma_noise_levels_and_colours(out: Path, tmp_path: Path) -> None:
    levels: dict[str, Any] = {"black_level": (60, 61, 62, 63), "white_level": 1000, "neutral": (0.5, 1, 0.7), "sensor": "mine"}
    calibration = SensorCalibration(gamma=(0.8, 1.0, 1.2), noise=NoiseModel((0.001,) * 4, (0.02,) * 4), **levels)
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(calibration.to_json()))
    scene = builtin_scene(24, 18)
    shot = simulate(out, "--camera", path, "--light", "1")
    # The camera does not know the colours, the scene does.
    assert shot.calibration == replace(read_camera(path).calibration, camera_to_xyz=scene.camera_to_xyz)
    paper = simulate(out, "--camera", path, "--sigma", "0.03", "--bits", "14").calibration
    assert (paper.gamma, paper.bits, paper.noise) == (calibration.gamma, 14, NoiseModel.gaussian(0.03, 4))


def test_linear_takes_numbers_for_light(out: Path, tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (18, 24, 3), np.uint8)
    Image.fromarray(picture).save(tmp_path / "picture.png")
    run("simulate", tmp_path / "picture.png", "-o", out, "--linear", "--truth", code=0)
    np.testing.assert_allclose(tifffile.imread(out / "picture.truth.tif"), picture / 255, atol=1e-6)


def test_several_scenes_and_their_records(out: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", np.linspace(0, 1, 12 * 13 * 3, dtype=np.float32).reshape(12, 13, 3))
    outcome = run("simulate", SOURCE, tmp_path / "ramp.npy", "-o", out, "--json", "--truth", code=0)
    assert [record["ok"] for record in outcome.records] == [True, True]
    outputs = [str(out / name) for name in ("ramp.dng", "ramp.truth.tif", "ramp.truth.png")]
    facts = {"source": str(tmp_path / "ramp.npy"), "ok": True, "outputs": outputs, "width": 13, "height": 12}
    assert outcome.records[1] == facts
    assert names(out) == {SHOT, TRUTH, SHOWN, "ramp.dng", "ramp.truth.tif", "ramp.truth.png"}


@pytest.mark.parametrize("light", [1, 0.25])
def test_the_truth_is_also_a_picture_to_look_at(out: Path, light: float) -> None:
    options = ("--light", str(light), "--truth")
    calibration = simulate(out, *options).calibration
    expected = ColourTransform.to_space(calibration).apply(tifffile.imread(out / TRUTH))
    np.testing.assert_allclose(np.asarray(Image.open(out / SHOWN)), 255 * expected, atol=1)
    before = (out / SHOWN).read_bytes()
    (out / SHOT).unlink()
    (out / TRUTH).unlink()
    assert "truth.png: exists already" in run("simulate", SOURCE, "-o", out, "--truth", code=1).err
    assert (out / SHOWN).read_bytes() == before
    assert names(out) == {SHOWN}


def test_without_known_colours_there_is_no_picture_of_the_truth_and_that_is_said(out: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "two.npy", np.full((24, 24, 2), 0.5, np.float32))
    outcome = run("simulate", tmp_path / "two.npy", "-o", out, "--pattern", "AB/WW", "--truth", "--json", code=0)
    assert "no .truth.png: the colours of the channels AB are unknown" in outcome.err
    assert {Path(name).name for name in outcome.records[0]["outputs"]} == names(out) == {"two.dng", "two.truth.tif"}


# --- bursts ---------------------------------------------------------------------------------------------------------------------

SERIES, HAND = "builtin:150x120", ["--burst", "3", "--motion", "2"]
FRAMES = [f"builtin-150x120-{number}.dng" for number in (1, 2, 3)]
BESIDE = {f"builtin-150x120.{ending}" for ending in ("truth.tif", "truth.png", "motion.json")}


def test_a_burst_is_a_series_of_shots_with_its_truth(out: Path) -> None:
    outcome = run("simulate", SERIES, "-o", out, *HAND, "--sigma", "0.02", "--seed", "3", "--truth", "--json", code=0)
    assert names(out) == {*FRAMES, *BESIDE}
    told = json.loads((out / "builtin-150x120.motion.json").read_text())
    hand = noise_of(3, "builtin-150x120-1.motion")
    frames = list(burst_frames(builtin_scene(150, 120).rgb, SimulatedBurst(3, 2), hand))
    for name, frame in zip(FRAMES, frames, strict=True):
        shot = read_dng(out / name)
        known = simulate_additive(frame.rgb, CfaPattern.bayer(), camera(), 0.02, noise_of(3, name))
        assert np.array_equal(shot.codes, known.codes)
        assert tuple(told["frames"][name][each] for each in ("down", "across")) == frame.motion.shift
        assert told["centre"] == [(count - 1) / 2 for count in shot.shape]
    assert told["reference"] == FRAMES[0]
    assert np.array_equal(tifffile.imread(out / "builtin-150x120.truth.tif"), frames[0].rgb)
    (record,) = outcome.records
    assert len(record["outputs"]) == 6
    assert record["reference"] == str(out / FRAMES[0])
    assert f"{out}/builtin-150x120.truth.tif: what {out / FRAMES[0]} sees, the reference; " in outcome.err
    assert (record["height"], record["width"]) == frames[0].rgb.shape[:2]


@pytest.mark.parametrize("protocol", [["--sigma", "0"], ["--light", "1"]])
def test_a_bracket_clips_and_its_files_state_the_exposure(out: Path, protocol: list[str]) -> None:
    run("simulate", SERIES, "-o", out, "--burst", "3", "--bracket", "0,-2,1.5", *protocol, code=0)
    shots = [read_dng(out / name) for name in FRAMES]
    times = [shot.metadata.exposure_time or 0 for shot in shots]
    assert [time / times[0] for time in times] == pytest.approx([1, 0.25, 2**1.5], rel=1e-6)
    assert np.median(shots[1].signal) == pytest.approx(np.median(shots[0].signal) / 4, rel=0.02)
    assert [shot.codes.max() == 4095 for shot in shots] == [False, False, True]


def test_a_scene_is_reduced_with_and_without_a_burst(out: Path, tmp_path: Path) -> None:
    rgb = np.random.default_rng(0).random((37, 48, 3), np.float32)
    np.save(tmp_path / "scene.npy", rgb)
    run("simulate", tmp_path / "scene.npy", "-o", out, "--reduce", "2", "--truth", code=0)
    truth = tifffile.imread(out / "scene.truth.tif")
    np.testing.assert_allclose(truth, rgb[:36].reshape(18, 2, 24, 2, 3).mean(axis=(1, 3)), rtol=1e-5)
    run("simulate", tmp_path / "scene.npy", "-o", out, "--reduce", "2", "--burst", "1", code=0)
    assert np.array_equal(read_dng(out / "scene-1.dng").codes, read_dng(out / "scene.dng").codes)


# --- what is refused ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (np.full((12, 12, 3), np.nan), "432 of 432 values are not finite"),
        (np.full((1, 1, 3), 0.5), "holds no whole colour block of this pattern (period 6)"),
        (np.array(["a"]), "expected unsigned integers or floating point"),
    ],
)
def test_what_is_no_scene_costs_one_line_and_the_rest_goes_on(out: Path, tmp_path: Path, array: Any, words: str) -> None:
    np.save(tmp_path / "bad.npy", array)
    outcome = run("simulate", tmp_path / "bad.npy", SOURCE, "-o", out, "--json", "--truth")
    assert_refused(outcome, words, name=str(tmp_path / "bad.npy"))
    assert [record["ok"] for record in outcome.records] == [False, True]
    assert outcome.records[0]["error"] == outcome.errors[0].removeprefix("panchroma: ")
    assert names(out) == {SHOT, TRUTH, SHOWN}
