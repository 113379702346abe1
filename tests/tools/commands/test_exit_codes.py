"""The exit code of a command is 0 exactly when all of its records say `ok`; nothing made is 1."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile

from tests.tools.capture.test_identity import SCENE, taken, tile_of
from tests.tools.command import run
from tests.tools.io.files import write_dng


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shots, scenes and frames, whole and damaged, each kind in a folder of its own."""
    bench = tmp_path_factory.mktemp("bench")
    run("simulate builtin:60x48 --sigma 0.01 -o", bench / "shots", code=0)
    run("simulate builtin:60x48 --burst 3 --motion 1 -o", bench / "frames", code=0)
    for name in ("mixed", "foreign", "scenes", "gone", "empty"):
        (bench / name).mkdir()
    shot = bench / "shots" / "builtin-60x48.dng"
    shutil.copytree(bench / "frames", bench / "torn")
    (bench / "torn" / "builtin-60x48-2.dng").write_bytes(shot.read_bytes()[:5000])
    for name in ("a-1.dng", "a-2.dng"):
        write_dng(bench / "foreign" / name, np.full((40, 60), 1000, np.uint16))
    write_dng(bench / "mixed" / "other.dng", np.full((40, 60), 1000, np.uint16))
    shutil.copy(shot, bench / "mixed")
    shutil.copy(shot, bench / "gone")
    (bench / "gone" / "torn.dng").write_bytes(shot.read_bytes()[:5000])
    picture = np.random.default_rng(0).integers(0, 4000, (40, 60, 3)).astype(np.uint16)
    tifffile.imwrite(bench / "scenes" / "x.tif", picture, photometric="rgb")
    np.save(bench / "unnamed.npy", taken(SCENE, tile_of("RWWG/WWWW/WBWW/WWWW")))
    (bench / "text.tif").write_text("no picture")
    return bench


GOOD = (
    "render shots -o out",
    "render mixed -o out",
    "render mixed -o out -n",
    "preview shots -o out",
    "preview mixed -o out",
    "inspect mixed",
    "inspect --verify mixed",
    "burst frames -o out",
    "simulate scenes -o out",
    "evaluate builtin:60x60 -o out --methods bilinear --sigma 0 -j 1",
    "capture builtin:48x36@50 --frames 2 -o out",
)
BAD = (
    "render foreign -o out",
    "render foreign -o out -n",
    "render gone -o out",
    "render gone -o out -j 2",
    "render empty shots -o out",
    "preview foreign -o out",
    "preview gone -o out",
    "inspect foreign",
    "inspect gone",
    "inspect --verify foreign",
    "inspect --verify gone",
    "burst foreign -o out",
    "burst torn -o out",
    "simulate text.tif -o out",
    "simulate scenes text.tif -o out",
    "identify text.tif",
    "identify unnamed.npy",
    "evaluate text.tif -o out",
    "evaluate builtin:60x60 text.tif -o out --methods bilinear --sigma 0 -j 1",
    "evaluate builtin:60x60 -o out --max-memory 1M",
    "calibrate shots -o out.json",
    "calibrate gone -o out.json",
)


@pytest.mark.parametrize("line", [*GOOD, *BAD])
def test_records_and_exit_code_agree(
    bench: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    monkeypatch.chdir(bench)
    try:
        outcome = run(f"{line} --json")
        assert outcome.code in (0, 1)
        assert bool(outcome.errors) == (line in BAD)
        assert [record["ok"] for record in outcome.records].count(False) > 0 or line in GOOD
        assert all(record["ok"] for record in outcome.records) == (outcome.code == 0)
        assert outcome.records
        for record in outcome.records:
            assert ("error" in record) != record["ok"]
        made = (bench / "out").exists() and any((bench / "out").rglob("*.*"))
        assert (bench / "out").exists() == made  # no empty folder is left
    finally:
        shutil.rmtree("out", ignore_errors=True)


@pytest.mark.parametrize("verb", ["render", "preview"])
def test_a_folder_without_anything_to_do_is_an_error(
    bench: Path, tmp_path: Path, verb: str
) -> None:
    outcome = run(verb, bench / "foreign", "-o", tmp_path / "out", code=1)
    (error,) = outcome.errors
    assert error.startswith(f"panchroma: {bench / 'foreign'}: nothing was done: ")
    assert not (tmp_path / "out").exists()
