"""`panchroma evaluate`, as a person or a script uses it."""

import json
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from panchroma.offline.version import ALGORITHM
from panchroma.tools.commands import evaluate
from panchroma.tools.evaluation.study import source_digest
from panchroma.tools.io.versions import program_version
from tests.scenes import leaves
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
    assert all(name in " ".join(outcome.errors) for name in ("cut.png", "tiny.npy"))
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
    exists = "exists already; --resume adds to it, --overwrite measures all again"
    for more in ("-q", "--dry-run"):
        assert exists in run("evaluate", *options, more, code=2).err
    listed = run("evaluate", *options, "--overwrite", "--dry-run", code=0).out
    assert listed.endswith("2 results to make, 0 kept from an earlier run\n")
    run("evaluate", *options, "--resume", code=0)
    assert (out / "evaluation.csv").read_text() != csv
    run("evaluate", *options, "--overwrite", code=0)
    assert (out / "evaluation.csv").read_text() == csv


@pytest.mark.parametrize("part", ["build_page", "render_crops"])
def test_the_tables_are_there_if_the_page_fails(
    part: str, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(evaluate, part, Mock(side_effect=RuntimeError("odd")))
    outcome = run("evaluate builtin:60x60 --methods bilinear --sigma 0 --json -o", out, code=1)
    page = str(out / "evaluation.html")
    (error,) = outcome.errors
    fault = "a fault of Panchroma, please report it: RuntimeError"
    assert error.startswith(f"panchroma: {page}: {fault}")
    assert {path.suffix for path in out.glob("e*")} == {".csv", ".json", ".svg"}
    assert json.loads((out / "evaluation.json").read_text())["figures"]
    ends = {record["source"]: record["ok"] for record in outcome.records}
    assert ends == {page: False, "builtin:60x60": True}


def test_dry_run_lists_the_work_for_patterns_of_every_kind(tmp_path: Path) -> None:
    mine = tmp_path / "mine.txt"
    # with a byte-order mark, as editors of Windows write it
    mine.write_text("# four wide\nCMWW\nYCWW\nWWWW\nWWWW\n", "utf-8-sig")
    options = f"--methods paper,bilinear --pattern K=4,{mine},WBWG/BWGW/WGWR/GWRW --dry-run"
    for levels, text in (("--light 0.25", "exposure 0.25"), ("--sigma 0.01", "sigma 0.01")):
        listed = run("evaluate builtin:60x60 -o", tmp_path, options, levels, code=0).out
        cases = (f"builtin-60x60, {text}: {name}\n" for name in CASES)
        assert listed == "".join(cases) + "4 results to make, 0 kept from an earlier run\n"


CASES = "paper K=4", "paper mine", "paper Kodak", "bilinear"
BANDS = "VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"


def five_bands(path: Path) -> str:
    of_bands = [[0.1, 0.2, 0.7], [0.8, 0.2, 0], [0.1, 0.8, 0.1], [0.5, 0.3, 0.2], [0, 0.3, 0.7]]
    np.save(path, leaves(66, 72, 0) @ np.array(of_bands, np.float32).T)
    return str(path)


def test_five_channels_are_compared_by_methods_of_ours(out: Path, tmp_path: Path) -> None:
    scene = five_bands(tmp_path / "bands.npy")
    Image.fromarray((small_scene(60, 66, 1) * 255).astype(np.uint8)).save(tmp_path / "rgb.png")
    options = f"--methods paper,best,preview,dlmmse,dcb --sigma 0,0.01 --jobs 1 --pattern {BANDS}"
    outcome = run("evaluate", scene, tmp_path / "rgb.png", "-o", out, options, code=1)
    assert "red, green and blue alone; left out: dlmmse, dcb" in outcome.err
    (line,) = outcome.errors
    assert line.endswith("rgb.png: its channels are RGB, and --pattern needs VRGNU")
    document = json.loads((out / "evaluation.json").read_text())
    assert document["protocol"]["channels"] == "VRGNU"
    assert list(document["methods"]) == ["paper", "best", "preview"]
    rows = {(row["method"], row["level"]): row for row in document["figures"] if row["scene"]}
    assert len(rows) == 6
    for row in rows.values():
        assert 15 < row["psnr"] < 60
        assert row["wrong_hue"] is None
    for level in (0.0, 0.01):
        others = [rows[name, level]["psnr"] for name in ("paper", "preview")]
        assert rows["best", level]["psnr"] > max(others)

    page = (out / "evaluation.html").read_text()
    assert "There is no verdict: it needs best, " in page
    assert "a Bayer camera under the same light" not in page


def test_the_json_says_what_made_it_and_no_page_the_folders(out: Path, tmp_path: Path) -> None:
    rival = of_quads(tmp_path, [1, 0, 0, 0, 0], "network", order="GRBG", inputs=QUADS)
    (tmp_path / "mine.py").write_text("def mine(mosaic):\n    return 1 / 0\n")
    methods = f"--methods=preview,dcb,{tmp_path}/mine.py:mine"
    words = (f"--sigma 0.01,0.02 --jobs 1 {methods} --rival", rival)
    outcome = run("evaluate builtin:60x60 --json -o", out, *words, code=1)
    assert not any(record["ok"] for record in outcome.records)  # a method has failed
    document = json.loads((out / "evaluation.json").read_text())
    assert document["source"] == source_digest()
    assert document["algorithm"] == ALGORITHM
    assert document["program"] == f"panchroma {program_version()}"
    command = document["command"]
    assert (command["verb"], command["scenes"]) == ("evaluate", ["builtin:60x60"])
    assert (command["sigma"], command["output"]) == ([0.01, 0.02], str(out))
    assert command["methods"] == methods.partition("=")[2].split(",")
    _, dcb, mine, network = document["methods"].values()
    for method in document["methods"].values():
        for package in ("numpy", "scipy", "numba", "onnxruntime"):
            assert method["packages"][package] == version(package)
    assert dcb["packages"]["rawpy"] == version("rawpy")
    assert mine["packages"]["pytest"] == version("pytest")  # it may import anything
    assert (mine["source"], network["source"]) == (f"{tmp_path}/mine.py:mine", rival)
    name = list(document["methods"])[2]
    fault = f"{tmp_path}/mine.py:mine, line 2: ZeroDivisionError: division by zero"
    assert document["failed"][0] == f"builtin:60x60: {name}, sigma 0.01: {fault}"
    page, table = ((out / f"evaluation.{end}").read_text() for end in ("html", "csv"))
    assert "mine.py:mine, line 2" in page
    for text in (page, table):
        assert "network-" in text
        assert str(tmp_path) not in text  # they are made to be shared


def test_without_a_result_it_fails_and_says_why(out: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def mine(mosaic):\n    return None\n")
    mine = f"--methods={tmp_path}/mine.py:mine"
    failed = run("evaluate builtin:60x60 --jobs 1 --sigma 0 -o", out, mine, code=1)
    assert "returned NoneType" in failed.errors[0]
    assert failed.errors[1].startswith("panchroma: nothing could be measured")
    assert not (out / "evaluation.html").exists()
