"""`panchroma evaluate`, as a person or a script uses it."""

import json
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from panchroma.tools.commands import evaluate
from tests.tools.command import run
from tests.tools.evaluation.examples import small_scene
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads


def times(folder: Path) -> dict[Path, int]:
    """When each file was written."""
    return {path: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_a_folder_of_mixed_files(out: Path, tmp_path: Path) -> None:
    (mixed := tmp_path / "mixed").mkdir()
    np.save(mixed / "light.npy", small_scene(66, 72, 0))
    Image.fromarray((small_scene(60, 66, 1) * 255).astype(np.uint8)).save(mixed / "kodim01.png")
    (mixed / "notes.txt").write_text("a note")
    (mixed / "cut.png").write_bytes((mixed / "kodim01.png").read_bytes()[:300])
    np.save(mixed / "tiny.npy", small_scene(20, 20, 0))
    options = ("-o", out, "--methods preview,bilinear --sigma 0,0.03 --jobs 1 --json")
    outcome = run("evaluate", mixed, "builtin:60x60", *options, code=1)
    assert len(outcome.errors) == 2
    for name in ("cut.png", "tiny.npy"):
        assert sum(name in line for line in outcome.errors) == 1
    assert "mixed: left out notes.txt" in outcome.err
    groups = [record["group"] for record in outcome.records if record["ok"]]
    assert groups == ["Kodak", "linear photographs", "built-in scenes"]
    assert sum(not record["ok"] for record in outcome.records) == 2
    document = json.loads((out / "evaluation.json").read_text())
    assert len(document["failed"]) == 2
    assert set(document["verdict"]) == set(groups)
    table = (out / "evaluation.csv").read_text()
    assert table.startswith("group,scene,level,method,period,rgb_q10")
    page = (out / "evaluation.html").read_text()
    assert "mixed/cut.png: " in page
    assert str(mixed.parent) not in page  # it is made to be shared

    # With --resume another method adds itself to what is kept.
    kept = times(out / "results")
    added = (*options, "--methods bilinear,dlmmse --resume")
    assert "6 results are kept" in run("evaluate", mixed, "builtin:60x60", *added, code=1).err
    after = times(out / "results")
    assert {path: after[path] for path in kept} == kept
    assert len(after) == len(kept) + 6
    assert "dlmmse" in (out / "evaluation.html").read_text()


def test_overwrite_measures_again(out: Path, tmp_path: Path) -> None:
    options = ("builtin:60x60", "-o", out, "--methods preview,bilinear --sigma 0.01 --jobs 1")
    run("evaluate", *options, code=0)
    results, csv = out / "results", (out / "evaluation.csv").read_text()
    # results as an earlier fault may have left them: of something else
    for path in results.iterdir():
        source = next(other for other in results.glob(f"*{path.suffix}") if other != path)
        path.write_bytes(source.read_bytes())
    exists = "evaluation.html: exists already; use `overwrite=True` to replace it"
    assert exists in run("evaluate", *options, code=2).err
    listed = run("evaluate", *options, "--overwrite", "--dry-run", code=0).out
    assert listed.endswith("2 results to make, 0 kept from an earlier run\n")
    run("evaluate", *options, "--resume", code=0)
    assert (out / "evaluation.csv").read_text() != csv
    run("evaluate", *options, "--overwrite", code=0)
    assert (out / "evaluation.csv").read_text() == csv


def test_a_rival_is_named_after_its_file_and_its_folder_is_not_told(
    out: Path, tmp_path: Path
) -> None:
    path = of_quads(tmp_path, [1, 0, 0, 0, 0], order="GRBG", inputs=QUADS)
    options = "--methods preview --sigma 0 --jobs 1 --rival"
    run("evaluate builtin:60x60 -o", out, options, path, code=0)
    page, csv, written = (
        (out / f"evaluation.{end}").read_text() for end in ("html", "csv", "json")
    )
    for text in (page, csv):
        assert "mine-" in text
        assert str(tmp_path) not in text
    assert "mine-" in list(json.loads(written)["methods"])[1]


@pytest.mark.parametrize("part", ["build_page", "render_crops"])
def test_the_tables_are_there_if_the_page_fails(
    part: str, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, part, Mock(side_effect=RuntimeError("odd")))
    line = "evaluate builtin:60x60 --methods bilinear --sigma 0 --json -o"
    outcome = run(line, out, code=1)
    page = str(out / "evaluation.html")
    (error,) = outcome.errors
    assert error.startswith(
        f"panchroma: {page}: a fault of Panchroma, please report it: RuntimeError"
    )
    assert {path.suffix for path in out.glob("e*")} == {".csv", ".json", ".svg"}
    assert json.loads((out / "evaluation.json").read_text())["figures"]
    assert {record["source"]: record["ok"] for record in outcome.records} == {
        page: False,
        "builtin:60x60": True,
    }


def test_dry_run_lists_the_work(tmp_path: Path) -> None:
    options = "--methods paper,bilinear --sigma 0.01 --pattern K=4,K=6 --dry-run"
    listed = run("evaluate builtin:60x60 -o", tmp_path, options, code=0).out.splitlines()
    names = [line.rpartition(": ")[2] for line in listed[:3]]
    assert names == ["paper K=4", "paper K=6", "bilinear"]
    assert listed[3].startswith("3 results to make, 0 kept")


def test_patterns_of_every_kind_are_compared(tmp_path: Path, out: Path) -> None:
    mine = tmp_path / "mine.txt"
    mine.write_text("# four wide\nCMWW\nYCWW\nWWWW\nWWWW\n")
    patterns = f"K=6,{mine},WBWG/BWGW/WGWR/GWRW"
    options = "--methods preview,bilinear --light 0.25 --jobs 1 --pattern"
    run("evaluate builtin:60x60 -o", out, options, patterns, code=0)
    document = json.loads((out / "evaluation.json").read_text())
    protocol = document["protocol"]
    assert (protocol["kind"], protocol["levels"], protocol["pattern"]) == ("sensor", [0.25], "K=6")
    assert list(protocol["patterns"]) == ["K=6", "mine", "Kodak"]
    assert {(row["method"], row["pattern"]) for row in document["figures"]} == {
        *(("preview", name) for name in protocol["patterns"]),
        ("bilinear", None),
    }


def test_two_patterns_of_one_name_are_refused(tmp_path: Path) -> None:
    for folder, letters in (("a", "GR/BG"), ("b", "BG/GR")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "mine.txt").write_text(
            "\n".join(f"{row}WW" for row in letters.split("/")) + "\nWWWW\nWWWW\n"
        )
    patterns = f"--pattern {tmp_path}/a/mine.txt,{tmp_path}/b/mine.txt"
    outcome = run("evaluate builtin:60x60 -o", tmp_path / "out", patterns, code=2)
    assert "different patterns are called 'mine'" in outcome.err
