"""`panchroma inspect`: every fact of a shot, for people and for machines. Bad shots: see
test_render.
"""

from pathlib import Path

import numpy as np
import pytest
import tifffile

from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, SensorCalibration
from panchroma.shared.dng import read_preview
from tests.shared.dng.examples import METADATA, calibration, mosaic
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import run
from tests.tools.io.examples import picture_dng


def rows(page: str) -> dict[str, str]:
    """Name -> value of the lines of a page that have a name."""
    return {line[2:16].strip(): line[16:] for line in page.splitlines()[1:] if line[2:16].strip()}


def test_machines_get_every_fact(tmp_path: Path) -> None:
    shot = mosaic()
    path = save_mosaic(tmp_path / "shot.dng", shot)
    (facts,) = run("inspect", "--json", path, code=0).records
    assert (facts["source"], facts["ok"]) == (str(path), True)
    assert (facts["width"], facts["height"], facts["bits"]) == (53, 37, 12)
    pattern, metadata = facts["pattern"], facts["metadata"]
    assert pattern["letters"] == list(shot.pattern.letters_from())
    assert (pattern["channels"], facts["learned"]) == ("RGB", "rggb-k6")
    assert pattern["light_efficiency"] == pytest.approx(3 * (32 + 4 / 2.73) / 36, abs=1e-3)
    assert SensorCalibration.from_json(facts["calibration"]) == shot.calibration
    assert facts["calibration_id"] == shot.calibration.id
    measured = shot.signal[shot.pattern.panchromatic_mask(shot.shape)]
    assert facts["mean_luminance"] == pytest.approx(measured.mean(dtype=np.float64))
    assert facts["saturated"] == pytest.approx((measured >= shot.calibration.full_scale).mean())
    assert 0 < facts["saturated"] < 1
    assert facts["preview_bytes"] == len(read_preview(path))
    assert metadata.pop("taken") == METADATA.taken.isoformat()
    assert metadata.pop("place") == pytest.approx([-33.857039, 151.211111], abs=1e-6)
    assert metadata == pytest.approx({name: getattr(METADATA, name) for name in metadata})


TOLD = {
    "size": "53 x 37 pixels; samples match their digest",
    "pattern": "paper, RGB period 6: RGWWWW/GBWWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW",
    "light": "2.79 times that of a Bayer sensor",
    "network": "rggb-k6",
    "levels": "black 256 257 258 259, white 3839 (12 bits)",
    "gamma": "0.7 0.91 1.12  (RGB)",
    "noise": "variance = 0.001 0.002 0.003 0.004 x signal + (0.01 0.005 0.00333333 0.0025)^2, "
    "scene units",
    "colour": "calibrated",
    "neutral": "0.5 0.6 0.7",
    "sensor": f"Prüfling 7, calibration {calibration().id}",
    "exposure time": "1/250 s",
    "f number": "2.8",
    "focal length": "34.56 mm",
    "altitude": "-2.5 m",
    **{name: getattr(METADATA, name) for name in ("make", "lens", "artist")},
}
PLAIN = {
    "levels": "black 256, white 3839 (12 bits)",
    "noise": "unknown",
    "colour": "no matrix",
    "neutral": "0.5 1 0.7, estimated from the picture",
    "exposure time": "1.0 s",
    "description": "two lines  [31m",
}


def plain() -> Mosaic:
    """A shot of which little is known."""
    sensor = SensorCalibration.of_bits(12, neutral=(0.5, 1, 0.7), neutral_estimated=True)
    metadata = CaptureMetadata(exposure_time=1.0, description="two\nlines \x1b[31m")
    return Mosaic(np.full((12, 12), 2000, np.uint16), CfaPattern.bayer(), sensor, metadata)


@pytest.mark.parametrize(("shot", "expected"), [(mosaic(), TOLD), (plain(), PLAIN)])
def test_people_get_them_with_their_units(
    tmp_path: Path, shot: Mosaic, expected: dict[str, str]
) -> None:
    path = save_mosaic(tmp_path / "shot.dng", shot)
    outcome = run("inspect", path, code=0)
    assert (outcome.err, outcome.out.splitlines()[0]) == ("", str(path))
    shown = rows(outcome.out)
    assert expected.items() <= shown.items()
    assert ("make" in shown) == (expected is TOLD)


def test_a_shot_without_a_panchromatic_pixel_has_no_brightness(tmp_path: Path) -> None:
    sensor = CfaPattern.bayer(), SensorCalibration.of_bits(12)
    path = save_mosaic(tmp_path / "shot.dng", Mosaic(np.full((2, 2), 900, np.uint16), *sensor))
    (facts,) = run("inspect", "--json", path).records
    assert (facts["mean_luminance"], facts["saturated"]) == (None, None)
    assert "no pixel is panchromatic" in run("inspect", path, code=0).out


def archive(folder: Path) -> list[Path]:
    """Shots and a rendered DNG in folders and below, and files that are none of them."""
    (folder / "a" / "b").mkdir(parents=True)
    shot, names = mosaic(shape=(20, 30)), ("1.dng", "2.DNG", "b/3.dng")
    paths = [save_mosaic(folder / "a" / name, shot) for name in names]
    picture = np.random.default_rng(1).random((20, 30, 3)).astype(np.float32)
    (folder / "4.dng").write_bytes(picture_dng(picture))
    (folder / "note.txt").write_text("no shot")
    (folder / ".5.dng.12345678.panchroma.part").write_text("no shot")
    return [*paths, folder / "4.dng"]


def test_an_archive_is_verified_and_the_damaged_are_named(tmp_path: Path) -> None:
    paths = archive(tmp_path)
    outcome = run("inspect", "--verify", tmp_path, paths[0], code=0)  # one is named twice
    assert (outcome.out, outcome.errors) == ("4 whole, 0 damaged or unreadable\n", [])
    assert outcome.err.startswith(f"{tmp_path}: left out note.txt\n")
    data = bytearray(paths[1].read_bytes())
    data[len(data) // 3] ^= 1
    paths[1].write_bytes(data)
    outcome = run("inspect", "--verify", "--json", tmp_path, code=1)
    whole = {"ok": True, "width": 30, "height": 20, "digest": "shot"}
    facts = {record.pop("source"): record for record in outcome.records}
    assert facts.keys() == set(map(str, paths))
    assert [name for name, fact in facts.items() if fact != whole] == [str(paths[1])]
    assert "3 whole, 1 damaged or unreadable" in outcome.err
    (line,) = outcome.errors
    assert line.startswith(f"panchroma: {paths[1]}: damaged")


def test_the_dng_of_another_program_is_not_damaged(tmp_path: Path) -> None:
    """A mosaic and a picture, as another maker's. One that has lost another name of ours is
    damaged.
    """
    shot, cut, _, picture = archive(tmp_path / "ours")
    (tmp_path / "theirs").mkdir()
    others = {str(tmp_path / "theirs" / path.name) for path in (shot, picture)}
    for path in (shot, picture):
        foreign = path.read_bytes().replace(b"Panchroma", b"Otherwise")
        (tmp_path / "theirs" / path.name).write_bytes(foreign)
    outcome = run("inspect", "--verify --json", tmp_path, code=0)
    assert outcome.errors == []
    assert "4 whole, 0 damaged or unreadable, 2 of other programs" in outcome.err
    assert {record["source"] for record in outcome.records if record.get("foreign")} == others
    for name in others:
        assert f"{name}: not a DNG of Panchroma: it has no digest" in outcome.err
    (tmp_path / "theirs" / "hurt.dng").write_bytes(shot.read_bytes()[:-512] + bytes(512))
    tifffile.imwrite(tmp_path / "theirs" / "scan.dng", np.zeros((9, 9), np.uint8))
    for command in ("inspect --verify", "render -n -o out"):
        outcome = run(command, tmp_path / "theirs", code=1)
        assert "scan.dng: not a " in outcome.err
        assert "hurt.dng: damaged: its first directory is not that of a picture" in outcome.err
    outcome = run("inspect", "--verify", *others, code=1)  # they were named
    assert (outcome.out, len(outcome.errors)) == ("0 whole, 2 damaged or unreadable\n", 2)
    for lost, told in ((b"Panchroma\0", "1 whole, 0"), (b"Panchroma mosaic\0", "0 whole, 1")):
        data = cut.read_bytes()
        assert lost in data
        cut.write_bytes(data.replace(lost, b"P" + bytes(len(lost) - 1)))
        assert run("inspect", "--verify", cut).out == f"{told} damaged or unreadable\n"


def test_a_damaged_preview_is_told(tmp_path: Path) -> None:
    path = save_mosaic(tmp_path / "shot.dng", mosaic())
    jpeg = read_preview(path)
    path.write_bytes(path.read_bytes().replace(jpeg, jpeg[:20] + bytes(len(jpeg) - 20)))
    (line,) = run("inspect", "--verify", path, code=1).errors
    assert f"{path}: damaged: the preview: a JPEG without a frame: it is cut short" in line


def test_a_shot_without_its_preview_is_shown(tmp_path: Path) -> None:
    """As exiftool -PreviewImage= leaves it: a strip of no bytes."""
    path = save_mosaic(tmp_path / "shot.dng", mosaic())
    with tifffile.TiffFile(path, mode="r+") as file:
        file.pages.first.tags["StripByteCounts"].overwrite(0)
    assert rows(run("inspect", path, code=0).out)["preview"] == "removed"
    assert "damaged: the preview" in run("inspect", "--verify", path, code=1).err
