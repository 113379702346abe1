"""A camera calibrated under two lights, with measured sensitivities: colours under a third light,
and what is refused.
"""

import json
import re
import shutil
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
from tifffile import TiffFile

from panchroma.shared import CfaPattern, DoubleArray, SensorCalibration, read_camera, read_dng
from panchroma.shared.white_balance import balanced
from panchroma.tools.calibration.colour_matrix import GREYS, fit_colour, light_change
from panchroma.tools.io.colour import delta_e_2000, encode_srgb, xyz_to_lab
from tests.sensitivities import CAMERAS, readings
from tests.tools.calibration.known_camera import (
    REFERENCE,
    TRUTH,
    edited,
    frame,
    save,
    stating,
    true_place,
)
from tests.tools.command import repeated, run
from tests.tools.io.examples import developed

CENTRES = true_place().centres
THIRD = "3200", "4000", "5000"
BAR = 1.3  # mean dE2000 under a third light, over that of a matrix fitted there
LOST = 2.0  # the same with one of the two lights alone, somewhere
LEVELS = 2.0  # of 255: between our own picture and that of a raw developer
EXPOSED = 0.9
Bench = tuple[str, Path]
"""A camera, and the folder of its charts."""


PLACES = [
    np.s_[top : top + 76, left : left + 74]
    for top in range(20, 380, 90)
    for left in range(40, 560, 88)
]
"""Where the patches are in a picture of the chart."""


def chart(camera: str, light: str) -> DoubleArray:
    """A picture of the chart, (400, 600, 3), scene units, as the camera reads it."""
    patches = EXPOSED * readings(camera, light)
    picture = np.tile(0.8 * patches[-1], (400, 600, 1))
    for place, patch in zip(PLACES, patches, strict=True):
        picture[place] = patch
    return picture


@pytest.fixture(scope="module", params=CAMERAS)
def bench(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """A camera, and the folder of its charts under A and D65 and of what `calibrate` makes of
    them.
    """
    folder = tmp_path_factory.mktemp("lights")
    for light in ("A", "D65"):
        save(folder / f"{light}.dng", frame(chart(request.param, light)))
    save(folder / "other.dng", frame(chart(request.param, "D65"), seed=1))
    save(folder / "grey.dng", frame(np.full((400, 600, 3), 0.2)))
    charts = [f"a={folder / 'A.dng'}", f"d65={folder / 'D65.dng'}"]
    outputs = ("-o", folder / "camera.json", "--report", folder)
    run("calibrate", *repeated("--chart-light", charts), *outputs, code=0)
    return request.param, folder


def mean_error(calibration: SensorCalibration, read: DoubleArray) -> float:
    """Mean dE2000 of the patches, balanced on the greys."""
    white = (read[list(GREYS)] / REFERENCE[list(GREYS), 1:2]).mean(axis=0)
    matrix = np.array(balanced(calibration, white).camera_to_xyz)
    lab = xyz_to_lab(read / white.max() @ matrix.T)
    return float(delta_e_2000(lab, xyz_to_lab(REFERENCE)).mean())


def test_a_third_light_has_nearly_the_colours_of_its_own_matrix(bench: Bench) -> None:
    camera, folder = bench
    two = read_camera(folder / "camera.json").calibration
    assert two.neutral is None
    single, (warm, cold) = replace(two, lights=None), two.lights
    alone = [
        replace(single, camera_to_xyz=light.camera_to_xyz, neutral=light.neutral)
        for light in (warm, cold)
    ]
    lost = []
    for light in THIRD:
        read = readings(camera, light)
        fitted = float(fit_colour(read, REFERENCE, CENTRES).difference.mean())
        assert mean_error(two, read) < BAR * fitted, light
        lost += [mean_error(one, read) / fitted for one in alone]
    assert max(lost) > LOST


@pytest.mark.parametrize("bench", CAMERAS[:1], indirect=True)
def test_it_is_shown_and_a_shot_states_both_matrices(bench: Bench, tmp_path: Path) -> None:
    camera, folder = bench
    lines = run("inspect", folder / "camera.json").out.splitlines()
    assert [line.split()[0] for line in lines if "; white " in line] == ["A", "D65"]
    assert "Colour under A" in (folder / "report.html").read_text("utf-8")
    known = read_camera(folder / "camera.json")
    shot = save(tmp_path / "shot.dng", known.calibrated(frame(chart(camera, "4000"))))
    assert read_dng(shot).calibration.lights == known.calibration.lights
    with TiffFile(shot) as file:
        tags = {tag.code: tag.value for tag in file.pages.first.tags}
    assert (tags[50778], tags[50779]) == (17, 21)
    for number, light in zip((50721, 50722), known.calibration.lights or (), strict=True):
        over, under = np.array(tags[number], float).reshape(-1, 2).T
        planes, expected = (over / under).reshape(4, 3), light.xyz_to_camera
        np.testing.assert_allclose(planes[:3] / planes[0, 0], expected / expected[0, 0], atol=1e-4)
        np.testing.assert_allclose(planes[3], known.calibration.gamma @ planes[:3], atol=1e-5)


@pytest.mark.parametrize("bench", CAMERAS[:1], indirect=True)
def test_raw_developers_show_the_colours_of_our_own_picture(bench: Bench, tmp_path: Path) -> None:
    """LibRaw takes the matrix for the light nearest to daylight, whatever the shot's; so the file
    states the one of the shot.
    """
    camera, folder = bench
    shot = save(tmp_path / "shot.dng", frame(chart(camera, "4000")))
    white = 1 / readings(camera, "4000")[list(GREYS)].mean(axis=0)
    balance = ",".join(map(str, white / white.min()))
    words = ("--camera", folder / "camera.json", "--wb", balance, "--preset", "paper")
    for kind in ("png", "dng"):
        run("render", shot, "-o", tmp_path / kind, "-f", kind, *words, code=0)
    theirs = developed(str(tmp_path / "dng" / "shot.dng"))
    ours = imagecodecs.png_decode((tmp_path / "png" / "shot.png").read_bytes())
    difference = np.abs(255 * encode_srgb(theirs.astype(np.float32)) - ours)
    assert difference.mean() < LEVELS / 4
    assert np.percentile(difference, 99.9) < LEVELS  # the rest is noise beyond what a file can hold


@pytest.mark.parametrize(
    ("charts", "code", "why"),
    [
        ("A=A 2900=D65", 2, "are alike"),
        ("A=A D65=D65 other", 2, "other.dng: shows a chart under neither light"),
        ("D65=A A=D65", 1, "A.dng is given as under D65 .* white changes -[01].* times as much"),
        ("A=D65 D65=other", 1, "white changes -?0.0 times as much .*--chart-light"),
        ("A=A 4000=D65", 1, "white changes [12].* times as much"),
        ("A=A A=other D65=D65", 1, "other.dng is given as under A .*, but white changes -?0.0"),
        ("A=A D65=grey", 1, "no chart without clipped patches was found under the light D65;"),
    ],
)
def test_charts_under_other_lights_than_those_named_and_what_are_no_two_lights_are_refused(
    bench: Bench, tmp_path: Path, charts: str, code: int, why: str
) -> None:
    output, words = tmp_path / "camera.json", list[str]()
    for chart in charts.split():
        light, is_named, shot = chart.rpartition("=")
        path = f"{bench[1] / shot}.dng"
        words += ["--chart-light", f"{light}={path}"] if is_named else [path]
    error = run("calibrate", *words, "-o", output, code=code).err
    assert not output.exists()
    assert re.search(why, error), error


@pytest.mark.parametrize("camera", CAMERAS)
def test_white_changes_between_charts_as_it_does_between_their_lights(camera: str) -> None:
    lights = ("A", "4000", "D50", "D65", "9000")
    fits = {light: fit_colour(readings(camera, light), REFERENCE, CENTRES) for light in lights}
    for one, other in combinations(fits, 2):
        assert 0.85 < light_change(fits[one], fits[other], (one, other)) < 1.55, (one, other)
        assert light_change(fits[other], fits[one], (one, other)) < -0.8, (one, other)


def raised(codes: DoubleArray, more: DoubleArray) -> DoubleArray:
    """The codes with so much more light."""
    black = TRUTH.black_level[-1]
    return np.where(more == 1, codes, (codes - black) * more + black)


def test_a_sensor_whose_white_does_not_follow_keeps_a_gamma_for_each_light(tmp_path: Path) -> None:
    """As bare silicon: panchromatic levels of a patch differ from Eq. 7, and with the light."""
    random, camera = np.random.default_rng(3), CAMERAS[0]
    weights = {"A": (0.9, 1.1, 0.8), "D65": (1.0, 1.05, 0.9)}
    read = readings(camera, "D65")
    colours = read / (read @ np.array(weights["D65"]))[:, None]
    deviations = random.normal(0, 0.01, 24)
    deviations -= colours @ np.linalg.lstsq(colours, deviations, rcond=None)[0]
    for light, gamma in weights.items():
        more = np.full((400, 600), np.nan)
        for place, read, deviation in zip(PLACES, readings(camera, light), deviations, strict=True):
            more[place] = (1 + deviation) * (read @ gamma) / (read @ np.array(TRUTH.gamma))
        clear = CfaPattern.bayer(6).panchromatic_mask(more.shape) & np.isfinite(more)
        more = np.where(clear, more, 1.0)
        taken = edited(frame(0.8 * chart(camera, light)), partial(raised, more=more))
        save(tmp_path / f"{light}.dng", stating(taken, black_level=TRUTH.black_level))
    charts = repeated("--chart-light", [f"{light}={tmp_path / light}.dng" for light in weights])
    output = tmp_path / "camera.json"
    said = run("calibrate", *charts, "-o", output, code=0).err
    assert re.search(r"W does not follow from R, G, B: .* by (0\.[6-9]|1\.\d) % beyond noise", said)
    found = read_camera(output)
    warm, cold = (np.array(under.gamma) for under in found.calibration.lights or ())
    np.testing.assert_allclose([warm, cold], list(weights.values()), rtol=0.15)
    assert warm[0] < found.calibration.gamma[0] < cold[0]
    run("calibrate", "--chart-light", charts[3], "-o", output, "--update", code=0)
    after = read_camera(output).calibration.lights or ()
    np.testing.assert_allclose(np.array(after[0].gamma), warm)
    run("calibrate", tmp_path / "A.dng", "-o", output, "--update", code=0)
    alone = read_camera(output).calibration
    assert (alone.lights or ())[0].gamma is None
    np.testing.assert_allclose(alone.gamma, warm, rtol=1e-6)


@pytest.mark.parametrize("bench", CAMERAS[:1], indirect=True)
def test_an_update_under_one_light_keeps_the_other(bench: Bench, tmp_path: Path) -> None:
    """A chart under a light without a name measures gamma alone."""
    _, folder = bench
    output = Path(shutil.copy(folder / "camera.json", tmp_path))
    before, update = read_camera(output), ("-o", output, "--update")
    run("calibrate", "--chart-light", f"D65={folder / 'other.dng'}", *update, code=0)
    after = read_camera(output)
    (warm, cold), (old_warm, old_cold) = after.calibration.lights, before.calibration.lights
    assert (warm, cold.illuminant) == (old_warm, "D65")
    assert cold.camera_to_xyz != old_cold.camera_to_xyz
    colour = after.measured["colour"]
    shots = dict(zip(colour["light"], colour["shot"], strict=True))
    assert shots == {"A": "A.dng", "D65": "other.dng"}
    outcome = run("calibrate", folder / "A.dng", *update, code=0)
    assert "the colours of the camera file, under A and D65, stay as they are" in outcome.err
    assert read_camera(output).calibration.lights == after.calibration.lights
    for light, why in (
        ("A", "white changes -?0.0 times as much"),
        ("D50", "one of two that the camera file"),
    ):
        wrong = run("calibrate", "--chart-light", f"{light}={folder / 'other.dng'}", *update)
        assert re.search(why, wrong.err), wrong.err
    assert read_camera(output).calibration.lights == after.calibration.lights
    changed = json.loads(output.read_text())
    changed["gamma"][0] *= 1.2
    output.write_text(json.dumps(changed))
    said = run("calibrate", folder / "A.dng", *update, code=0).err
    assert re.search(r"gamma was .* in the camera file, and is .*: they differ by \d+ times", said)
