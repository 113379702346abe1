"""`panchroma simulate`: scenes become shots, every option counts, and what is no scene costs one
line.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image

from panchroma.shared import Camera, CfaPattern, NoiseModel, SensorCalibration, read_dng
from panchroma.tools.batch.journal import NAME as JOURNAL
from panchroma.tools.commands.simulate import noise_of
from panchroma.tools.io.display import ColourTransform
from panchroma.tools.simulation.drawn.builtin import builtin_scene
from panchroma.tools.simulation.sensor import simulate_additive, simulate_sensor, typical_noise
from panchroma.tools.simulation.simulated_camera import SimulatedBurst, burst_frames
from tests.tools.command import assert_refused, contents, results, run

SOURCE = "builtin:24x18"
SHOT, TRUTH, SHOWN = (f"builtin-24x18.{ending}" for ending in ("dng", "truth.tif", "truth.png"))


def camera(bits: int = 12, **fields: Any) -> SensorCalibration:
    """What the command takes without --camera, for the built-in scene."""
    scene = builtin_scene(24, 18)
    colours = {"camera_to_xyz": scene.camera_to_xyz, "neutral": scene.neutral}
    return SensorCalibration.of_bits(bits, **{"sensor": "simulated", **colours, **fields})


def simulate(out: Path, *options: str | Path) -> Any:
    """The shot of the built-in scene that is made with `options`."""
    run("simulate", SOURCE, "-o", out, "--overwrite", *options, code=0)
    return read_dng(out / SHOT)


# --- what is made --------------------------------------------------------------------------------


def test_a_shot_is_the_forward_model_of_the_scene(out: Path) -> None:
    scene = builtin_scene(24, 18).rgb
    expected = simulate_additive(scene, CfaPattern.bayer(), camera(), 0.02, noise_of(7, SHOT))
    shot = simulate(out, "--sigma 0.02 --seed 7 --truth")
    truth = tifffile.imread(out / TRUTH)
    assert np.array_equal(shot.codes, expected.codes)
    assert (shot.pattern, shot.calibration) == (expected.pattern, expected.calibration)
    assert results(out) == {SHOT, TRUTH, SHOWN}
    assert truth.dtype == np.float32
    assert np.array_equal(truth, scene)


def test_the_sensor_protocol_clips_and_counts_photons(out: Path) -> None:
    calibration = camera(white_level=4095)  # the sensor ends where its codes do
    scene, rng = builtin_scene(24, 18).rgb, noise_of(0, SHOT)
    expected = simulate_sensor(scene, CfaPattern.bayer(), calibration, 4.0, rng)
    shot = simulate(out, "--light 4")
    assert np.array_equal(shot.codes, expected.codes)
    assert shot.calibration.noise == typical_noise(calibration)
    assert shot.codes.max() == 4095
    run("simulate", SOURCE, "-o", out, "--light 4 -f raw", code=0)
    assert (out / "builtin-24x18.raw").read_bytes() == shot.codes.astype("<u2").tobytes()


def test_shots_of_a_command_have_noise_of_their_own_in_any_order(out: Path, tmp_path: Path) -> None:
    """Two flat frames with the same noise would measure no noise at all."""
    sources = [tmp_path / "flat1.npy", tmp_path / "flat2.npy"]
    for source in sources:
        np.save(source, np.full((36, 36, 3), 0.5, np.float32))
    white = CfaPattern.bayer().panchromatic_mask((36, 36))
    for noise in ("--sigma 0.1", "--light 1"):
        run("simulate", *sources, "--overwrite -o", out, noise, code=0)
        one, other = (read_dng(out / f"flat{number}.dng").codes.astype(float) for number in (1, 2))
        assert abs(np.corrcoef(one[white], other[white])[0, 1]) < 0.2
        run("simulate", *reversed(sources), "--overwrite -o", out, noise, code=0)
        assert np.array_equal(read_dng(out / "flat1.dng").codes, one)


@pytest.mark.parametrize(
    ("option", "light"),
    [("--shading 1,10", 0.25), ("--reduce 2", 0.25), ("--burst 2 --motion 1 --bracket=-1,1", 3)],
)
def test_the_truth_is_as_bright_as_a_render_under_any_light(
    out: Path, option: str, light: float
) -> None:
    """It is the light of the scene times light and exposure, in each protocol."""
    source, truth = "builtin:96x72", out / "builtin-96x72.truth.tif"
    run("simulate", source, "-o", out, f"--truth --light {light}", option, code=0)
    under_light = tifffile.imread(truth)
    run("simulate", source, "-o", out, "--truth --overwrite", option, code=0)
    np.testing.assert_allclose(under_light, tifffile.imread(truth) * light, rtol=1e-6)


def test_a_camera_file_gives_gamma_noise_levels_and_colours(out: Path, tmp_path: Path) -> None:
    levels: Any = {"black_level": (60, 61, 62, 63), "white_level": 1000, "neutral": (0.5, 1, 0.7)}
    gamma, noise = (0.8, 1.0, 1.2), NoiseModel((0.001,) * 4, (0.02,) * 4)
    calibration = SensorCalibration(gamma=gamma, noise=noise, sensor="mine", **levels)
    path = tmp_path / "camera.json"
    measured = replace(calibration, defects=((3, 4),))  # no simulated pixel is defective
    path.write_text(json.dumps(measured.to_json()))
    shot = simulate(out, "--light 1 --camera", path)
    # The camera does not know the colours, the scene does.
    colours: Any = {"camera_to_xyz": builtin_scene(24, 18).camera_to_xyz, "camera": measured.id}
    assert shot.calibration == replace(calibration, **colours)
    paper = simulate(out, "--sigma 0.03 --sensor-bits 14 --camera", path).calibration
    assert (paper.gamma, paper.bits) == (gamma, 14)
    assert paper.noise == NoiseModel.gaussian(0.03, 4)


def test_without_known_colours_there_is_no_picture_of_the_truth(out: Path, tmp_path: Path) -> None:
    np.save(tmp_path / "two.npy", np.full((24, 24, 3), 0.5, np.float32))
    run("simulate", tmp_path / "two.npy", "--truth -o", out, code=0)  # has a picture, which goes
    np.save(tmp_path / "two.npy", np.full((24, 24, 2), 0.5, np.float32))
    options = "--pattern AB/WW --truth --resume --json -o"
    outcome = run("simulate", tmp_path / "two.npy", options, out, code=0)
    assert "no .truth.png: the colours of the channels AB are unknown" in outcome.err
    outputs = {Path(name).name for name in outcome.records[0]["outputs"]}
    assert outputs == results(out) == {"two.dng", "two.truth.tif"}
    assert run("simulate", tmp_path / "two.npy", options, out, code=0).records[0]["current"]


def test_no_scene_costs_one_line_and_the_rest_is_recorded(out: Path, tmp_path: Path) -> None:
    codes = np.random.default_rng(0).integers(0, 256, (13, 15, 3), np.uint8)
    bad, picture = tmp_path / "bad.npy", tmp_path / "picture.png"
    Image.fromarray(codes).save(picture)
    np.save(bad, np.full((12, 12, 3), np.nan))
    outcome = run("simulate", bad, SOURCE, picture, "--json --truth --linear -o", out)
    assert_refused(outcome, "432 of 432 values are not finite", name=str(bad))
    first, _, last = outcome.records
    assert first["error"] == outcome.errors[0].removeprefix("panchroma: ")
    outputs = [str(out / f"picture.{ending}") for ending in ("dng", "truth.tif", "truth.png")]
    facts = {"outputs": outputs, "width": 15, "height": 13}
    assert last == {"source": str(picture), "ok": True, **facts}
    assert results(out) == {SHOT, TRUTH, SHOWN, *(Path(name).name for name in outputs)}
    np.testing.assert_allclose(tifffile.imread(out / "picture.truth.tif"), codes / 255, atol=1e-6)


def test_the_truth_is_also_a_picture_and_nothing_of_a_user_is_replaced(out: Path) -> None:
    calibration = simulate(out, "--light 1/4 --truth").calibration
    expected = ColourTransform.to_space(calibration).apply(tifffile.imread(out / TRUTH))
    np.testing.assert_allclose(np.asarray(Image.open(out / SHOWN)), 255 * expected, atol=1)
    before = (out / SHOWN).read_bytes()
    (out / SHOT).unlink()
    (out / TRUTH).unlink()
    assert "truth.png: exists already" in run("simulate", SOURCE, "-o", out, "--truth", code=1).err
    assert results(out) == {SHOWN}
    assert (out / SHOWN).read_bytes() == before


@pytest.mark.parametrize(
    ("earlier", "later", "left_over"),
    [
        ("--truth", "--light 2", {TRUTH, SHOWN}),
        ("--burst 3 --truth", "--burst 2 --truth", {"builtin-24x18-3.dng"}),
        ("--burst 2 --truth", "--burst 2 --seed 1", {TRUTH, SHOWN, "builtin-24x18.motion.json"}),
        ("--truth", "-f raw", set()),
    ],
)
@pytest.mark.parametrize("replace", ["--overwrite", "--resume"])
def test_what_does_not_belong_to_the_new_shot_is_named_and_stays(
    out: Path, earlier: str, later: str, left_over: set[str], replace: str
) -> None:
    run("simulate", SOURCE, "builtin:30x24", "-o", out, earlier, code=0)
    before = {name: (out / name).read_bytes() for name in results(out)}
    outcome = run("simulate", SOURCE, "-o", out, later, replace, code=0)
    assert all((out / name).read_bytes() == before[name] for name in left_over)
    assert outcome.err.count("was made with what is replaced") == len(left_over)
    assert all(f"{out / name}: was made with" in outcome.err for name in left_over)


@pytest.mark.parametrize("jobs", ["-j 1", "-j 2"])
def test_frames_that_the_same_run_makes_are_not_called_old(
    out: Path, tmp_path: Path, jobs: str
) -> None:
    """Those that it has yet to make as little as those that it has made."""
    for name in ("a", "a-1", "a-2"):
        tifffile.imwrite(tmp_path / f"{name}.tif", np.full((24, 30, 3), 20000, np.uint16))
    run("simulate", tmp_path / "a.tif", "-o", out, "--burst 2", code=0)
    scenes = tmp_path / "a-1.tif", tmp_path / "a-2.tif"
    outcome = run("simulate", *scenes, "-o", out, "--overwrite", jobs, code=0)
    assert "was made" not in outcome.err
    assert {"a-1.dng", "a-2.dng"} <= results(out)


# --- bursts --------------------------------------------------------------------------------------

FRAMES = [f"builtin-150x120-{number}.dng" for number in (1, 2, 3)]
BESIDE = {f"builtin-150x120.{ending}" for ending in ("truth.tif", "truth.png", "motion.json")}


def test_a_burst_is_a_series_of_shots_with_its_truth(out: Path) -> None:
    options = "--burst 3 --motion 2 --sigma 0.02 --seed 3 --truth --json"
    outcome = run("simulate builtin:150x120 -o", out, options, code=0)
    assert results(out) == {*FRAMES, *BESIDE}
    told = json.loads((out / "builtin-150x120.motion.json").read_text())
    hand = noise_of(3, "builtin-150x120-1.motion")
    frames = list(burst_frames(builtin_scene(150, 120).rgb, SimulatedBurst(3, 2), hand))
    for name, frame in zip(FRAMES, frames, strict=True):
        shot = read_dng(out / name)
        known = simulate_additive(frame.rgb, CfaPattern.bayer(), camera(), 0.02, noise_of(3, name))
        assert np.array_equal(shot.codes, known.codes)
        motion = told["frames"][name]
        assert (motion["down"], motion["across"]) == frame.motion.shift
        assert told["centre"] == [(count - 1) / 2 for count in shot.shape]
    assert told["reference"] == FRAMES[0]
    assert np.array_equal(tifffile.imread(out / "builtin-150x120.truth.tif"), frames[0].rgb)
    (record,) = outcome.records
    assert len(record["outputs"]) == 6
    assert record["reference"] == str(out / FRAMES[0])
    assert (record["height"], record["width"]) == frames[0].rgb.shape[:2]


def test_scenes_are_resumed_tried_and_made_several_at_a_time(tmp_path: Path, out: Path) -> None:
    other, camera = tmp_path / "other", tmp_path / "camera.json"
    scenes = [f"builtin:{size}x60" for size in (72, 78, 84)]
    line = ("simulate", *scenes, "--burst 2 --motion 2 --light 1 --truth")
    assert len(run(*line, "-n -o", out, code=0).out.splitlines()) == 3
    assert contents(out) == {}
    run(*line, "-j 3 -o", out, code=0)
    run(*line, "-o", other, code=0)
    made = contents(out)
    assert made.keys() == contents(other).keys()
    assert {name for name, data in contents(other).items() if data != made[name]} == {JOURNAL}
    for resumed in (line, (*line[:-1], "--burst 2 --motion 2 --light 1")):  # the truth may stay
        assert run(*resumed, "--resume -o", out, code=0).out.count("is up to date") == 3
    assert contents(out) == made
    (out / "builtin-72x60-2.dng").unlink()
    (out / "builtin-78x60-1.dng").write_bytes(b"edited")
    (out / "builtin-84x60.motion.json").write_bytes(made["builtin-84x60.motion.json"][:9])
    outcome = run(*line, "--resume -o", out, code=0)
    assert "up to date" not in outcome.out
    assert outcome.err.count("has changed since it was made; it is kept as") == 2
    assert {name for name, data in made.items() if data != contents(out)[name]} == {JOURNAL}
    run(*line, "--seed 1 --resume -o", out, code=0)
    assert contents(out)["builtin-72x60-1.dng"] != made["builtin-72x60-1.dng"]
    for gamma in (0.9, 0.8):
        known = Camera(SensorCalibration.of_bits(12, gamma=(1.0, gamma, 1.0)))
        camera.write_text(json.dumps(known.to_json()))
        measured = ("simulate", scenes[0], "--camera", camera, "--resume -o", tmp_path / "measured")
        assert "up to date" not in run(*measured, code=0).out
        assert "up to date" in run(*measured, code=0).out
