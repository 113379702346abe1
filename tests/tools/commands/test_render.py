"""`panchroma render`: the command gives what the library gives, in every format, and a bad shot
costs one line.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import ArrayLike

from panchroma.offline import PRESETS, render
from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration, read_dng
from panchroma.tools.io.development import Development
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.kind import PictureKind
from tests.shared.test_white_balance import LIGHT
from tests.shared.test_white_balance import shot as coloured_light
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, results, run
from tests.tools.io.examples import encode_picture

SCENE = (48, 36)
SOURCE = f"builtin:{SCENE[0]}x{SCENE[1]}"
STEM = SOURCE.replace(":", "-")
MEASURED = ("--preset", "paper", "--bits", "32", "--space", "camera")


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A noisy shot of the built-in scene, 16 bits, with its truth beside it."""
    folder = tmp_path_factory.mktemp("shots")
    run("simulate", SOURCE, "-o", folder, "--bits", "16", "--sigma", "0.02", "--truth", code=0)
    return folder / f"{STEM}.dng"


def save(path: Path, codes: ArrayLike | None = None) -> Path:
    """A shot of these codes, of random ones without, 13 x 17."""
    samples = np.random.default_rng(0).integers(256, 3839, (13, 17), np.uint16)
    if codes is not None:
        samples[:] = codes
    metadata = CaptureMetadata(make="Contax", iso=400, orientation=6)
    return save_mosaic(
        path, Mosaic(samples, CfaPattern.bayer(), SensorCalibration.of_bits(12), metadata)
    )


# --- what is made --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        *((name, PictureKind.of(name)) for name in FORMATS),
        ("jpg --quality 30", PictureKind.of("jpg", quality=30)),
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
    outcome = run(
        "render", shot, "-o", out, "-f", *options.split(), "--exposure", str(exposure), code=0
    )
    mosaic, path = read_dng(shot), out / f"shot{kind.suffix}"
    rendering, development = (
        render(mosaic),
        Development(kind, mosaic.shape, mosaic.calibration, mosaic.metadata, exposure),
    )
    assert path.read_bytes() == encode_picture(
        development.whitened(rendering.rgb, rendering.lost), development
    )
    assert results(out) == {path.name}
    rows, columns = (13, 17) if kind.space == "camera" else (17, 13)
    assert outcome.out.startswith(f"{path}: {columns} x {rows}, {kind.bits} bits, {kind.space}, ")


@pytest.mark.parametrize(("name", "ending"), [("tiff", "tif"), ("jpeg", "jpg")])
def test_formats_have_their_other_names(out: Path, shot: Path, name: str, ending: str) -> None:
    run("render", shot, "-o", out, "-f", name, code=0)
    assert results(out) == {f"{shot.stem}.{ending}"}


def uncalibrated(path: Path, level: float = 0.8) -> Path:
    """A shot of a grey scene under coloured light by a sensor that nobody has calibrated."""
    return save_mosaic(
        path,
        Mosaic(
            coloured_light(level=level).codes, CfaPattern.bayer(6), SensorCalibration.of_bits(12)
        ),
    )


def cast(path: Path) -> float:
    """How far the picture's mean colour is from grey."""
    mean = tifffile.imread(path).mean(axis=(0, 1))
    return float(np.ptp(mean) / mean.mean())


def test_white_balance_as_shot_estimated_and_given(out: Path, tmp_path: Path) -> None:
    shot = uncalibrated(tmp_path / "a.dng")
    multipliers = ",".join(str(1 / level) for level in LIGHT)
    for balance, balanced_ in (
        ((), False),
        (("--wb", "auto"), True),
        (("--wb", multipliers), True),
    ):
        options = ("--preset", "paper", "--overwrite", *balance)
        outcome = run("render", shot, "-o", out, *options, "--json", code=0)
        assert (cast(out / "a.tif") < 0.03) == balanced_, options
        assert ("white balance is unknown" in outcome.err) == (not balanced_)
        assert outcome.records[0]["neutral_estimated"] == ("auto" in options)
        run("render", shot, "-o", out, "-f", "dng", *options, code=0)
        with tifffile.TiffFile(out / "a.dng") as file:
            stated = np.array(file.pages.first.tags.valueof(50728)).reshape(3, 2)
        assert np.allclose(stated[:, 0] / stated[:, 1], LIGHT if balanced_ else 1, atol=0.05)


def test_a_white_balance_that_a_shot_does_not_allow(out: Path, tmp_path: Path) -> None:
    dim = uncalibrated(tmp_path / "dim.dng", level=0.004)
    assert_refused(
        run("render", dim, "-o", out, "--wb", "auto"),
        "too dark, too bright or too small",
        name=str(dim),
    )
    assert_refused(
        run("render", dim, "-o", out, "--wb", "2,1"),
        "`wb` has 2 multipliers",
        "R, G, B",
        name=str(dim),
    )


def test_a_dry_run_checks_and_does_nothing(
    out: Path, shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("rendered")

    monkeypatch.setattr("panchroma.offline.measure", fail)
    (tmp_path / "text.dng").write_text("no picture")
    (out / "old.tif").write_text("old")
    old = save(tmp_path / "old.dng")
    outcome = run(
        "render", shot, tmp_path / "text.dng", old, "-o", out, "--dry-run", "--json", code=1
    )
    found = {
        Path(record["source"]).name: (record["ok"], record.get("dry_run"))
        for record in outcome.records
    }
    assert found == {shot.name: (True, True), "text.dng": (False, None), "old.dng": (False, None)}
    assert f"{shot} -> {out / f'{STEM}.tif'}" in outcome.err
    assert results(out) == {"old.tif"}


def test_records_for_machines(out: Path, shot: Path) -> None:
    outcome = run("render", shot, "-o", out, "--json")
    (record,) = outcome.records
    assert record.pop("seconds") >= 0
    solvers = record.pop("solvers")
    assert list(solvers) == ["luminance", "medians", "affinity"]
    assert all(
        0 < each["iterations"] <= 100 and 0 <= each["residual"] < 1e-2 for each in solvers.values()
    )
    assert record == {
        "source": str(shot),
        "ok": True,
        "output": str(out / f"{STEM}.tif"),
        "width": 48,
        "height": 36,
        "neutral": [1.0, 1.0, 1.0],
        "neutral_estimated": False,
        "learned": "rggb-k6",
    }
    assert f"{STEM}.tif: 48 x 36" in outcome.err
    assert ": luminance " in outcome.err


def test_the_network_can_be_left_out(out: Path, shot: Path) -> None:
    for preset, network in (("best", "rggb-k6"), ("unlearned", None), ("paper", None)):
        (record,) = run(
            "render", shot, "-o", out, "--json", "--overwrite", *MEASURED[2:], "--preset", preset
        ).records
        assert record["learned"] == network
        assert np.array_equal(
            tifffile.imread(out / f"{STEM}.tif"), render(read_dng(shot), PRESETS[preset]).rgb
        )


def test_unknown_noise_is_said(out: Path, tmp_path: Path, shot: Path) -> None:
    words, unknown = "the noise level is unknown and ", save(tmp_path / "shot.dng")
    assert words + "estimated from the shot" in run("render", unknown, "-o", out).err
    assert (
        words + "taken as zero"
        in run("render", unknown, "-o", out, "--preset", "paper", "--overwrite").err
    )
    assert words not in run("render", shot, "-o", out, "--overwrite").err


# --- what is refused -----------------------------------------------------------------------------


def flipped(data: bytes, place: int) -> bytes:
    return data[:place] + bytes([data[place] ^ 4]) + data[place + 1 :]


BAD_SHOTS: dict[str, tuple[Callable[[bytes], bytes], str]] = {
    "bit flipped in the samples": (
        lambda data: flipped(data, data.find(b"\xff\xc3") + 300),
        "damaged: the samples differ",
    ),
    "text": (lambda _: b"Hello\n", "not a DNG: it does not begin like a TIFF file; give a shot"),
}


@pytest.mark.parametrize("verb", [("render", "-o"), ("inspect",), ("inspect", "--verify")])
@pytest.mark.parametrize("kind", BAD_SHOTS)
def test_a_bad_shot_costs_one_line_and_the_rest_goes_on(
    out: Path, tmp_path: Path, shot: Path, kind: str, verb: tuple[str, ...]
) -> None:
    damage, words = BAD_SHOTS[kind]
    bad = tmp_path / "bad.dng"
    bad.write_bytes(damage(shot.read_bytes()))
    before = bad.read_bytes(), shot.read_bytes()
    outcome = run(*verb, *([out] if "-o" in verb else []), bad, shot, "--json")
    assert_refused(outcome, words, name=str(bad))
    assert [record["ok"] for record in outcome.records] == [False, True]
    assert results(out) == ({f"{STEM}.tif"} if "-o" in verb else set())
    assert (bad.read_bytes(), shot.read_bytes()) == before


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


def test_a_frame_whose_colour_samples_alone_are_not_saturated_is_a_picture_for_best(
    out: Path, tmp_path: Path
) -> None:
    """`best` takes luminance from them; the published method has none to begin with."""

    clear = CfaPattern.bayer().panchromatic_mask((13, 17))
    shot = save(tmp_path / "shot.dng", np.where(clear, 4000, 2400))
    words = "every panchromatic sample is saturated: there is no picture in it; expose less"
    assert_refused(run("render", shot, "-o", out, "--preset", "paper"), words, name=str(shot))
    assert results(out) == set()
    run("render", shot, "-o", out, "--bits", "32", "--space", "camera", code=0)
    calibration = read_dng(shot).calibration
    light = tifffile.imread(out / "shot.tif").astype(np.float64) @ np.array(calibration.gamma)
    expected = (
        (2400 - calibration.black_level[0]) * calibration.scale().max() * sum(calibration.gamma)
    )
    assert abs(light.mean() / expected - 1) < 0.02
    assert expected > calibration.full_scale


def test_a_frame_with_one_pixel_of_light_is_a_picture(out: Path, tmp_path: Path) -> None:
    for others, one in ((256, 300), (4000, 2000)):
        light = np.full((13, 17), others)
        light[4, 4] = one
        shot = save(tmp_path / f"{one}.dng", light)
        run("render", shot, "-o", out, *MEASURED, code=0)
        assert np.isfinite(tifffile.imread(out / f"{one}.tif")).all()
