"""`evaluate --resume` keeps a result only while all it depends on is the same."""

from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from PIL import Image

from panchroma.offline import PAPER, render
from panchroma.shared import SensorCalibration
from panchroma.shared.errors import ConvergenceError, InputError
from panchroma.shared.pattern import CfaPattern
from panchroma.tools.evaluation import methods as registry
from panchroma.tools.evaluation import study as module
from panchroma.tools.evaluation.evaluation_page import WORST, Crop, render_exhibit
from panchroma.tools.evaluation.figures import Place
from panchroma.tools.evaluation.metrics import (
    PLANES,
    QUANTILES,
    Measures,
    patch_psnr,
    quality,
    whole_psnr,
)
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.evaluation.study import (
    FOLDER,
    Case,
    Study,
    collect,
    missing_cases,
    name_case,
    source_digest,
    work,
)
from panchroma.tools.simulation.protocols import PaperProtocol, SensorProtocol
from panchroma.tools.simulation.sensor import simulate_additive
from tests.bayer import bayer_mosaic
from tests.tools.command import run
from tests.tools.evaluation.examples import alone, measured, pair, small_scene, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads
from tests.walking import CHANGED, one_field_changed

# --- study ----------------------------------------------------------------------------------------

NOISY = PaperProtocol(0.03)


def works(study: Study, folder: Path, cases: list[Case]) -> list[str]:
    return [line for case in cases for line in work(study, folder, case)]


def test_figures_are_those_of_simulating_rendering_and_measuring_by_hand(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path), tmp_path)
    maps, pattern, camera = [], CfaPattern.bayer(6), SensorCalibration()
    for seed in range(2):
        truth = small_scene(78, 90 + 12 * seed, seed)
        bayer = demosaic_bilinear(bayer_mosaic(truth, 0.03, np.random.default_rng(0)))
        mosaic = simulate_additive(truth, pattern, camera, 0.03, np.random.default_rng(0))
        sparse = render(mosaic, PAPER).rgb
        for name, picture in (("bilinear", bayer), ("paper", sparse)):
            title = f"scene{seed}, sigma 0.03: {name}{' K=6' * (name == 'paper')}"
            (measures,) = (kept for case, kept in figures.results.items() if case.title == title)
            assert np.array_equal(measures.quality, quality(picture, truth))
            assert np.array_equal(measures.psnr, whole_psnr(picture, truth, 15))
        maps.append(patch_psnr(sparse, truth))
    values = figures.of(Place(figures.groups[0], NOISY), "paper").values
    for name, planes in zip(PLANES, zip(*maps, strict=True), strict=True):
        expected = np.quantile(np.concatenate([plane.ravel() for plane in planes]), QUANTILES)
        pooled = [values[f"{name}_q{round(100 * quantile)}"] for quantile in QUANTILES]
        assert pooled == pytest.approx(expected, abs=0.01)


def test_everything_that_changes_a_result_changes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = study_of(tmp_path, methods=("paper",), count=1)
    scene, method, tile = study.scenes[0], registry.methods()["dlmmse-wb"], study.tile

    def name_of(**changes: Any) -> str:
        facts = {"scene": scene, "level": NOISY, "method": method, "tile": tile}
        return name_case(**(facts | changes)).name  # type: ignore[arg-type]

    assert name_of(tile=replace(tile, name="mine")) == name_of()  # the pattern is the same
    other: dict[str, str] = {}
    for level in (PaperProtocol(0.02), SensorProtocol(0.03)):
        other[str(level)] = name_of(level=level)
    for name, pattern in one_field_changed(tile.pattern):
        other[f"pattern.{name}"] = name_of(tile=replace(tile, pattern=pattern))
    for name in ("digest", "neutral"):
        other[name] = name_of(scene=replace(scene, **{name: CHANGED}))  # type: ignore[arg-type]
    changes = {"name": "dcb", "version": "2", "balanced": False, "packages": ("rawpy",)}
    for name, change in changes.items():
        other[name] = name_of(method=replace(method, **{name: change}))  # type: ignore[arg-type]
    for package in ("numba", "numpy", "onnxruntime", "scipy"):
        with monkeypatch.context() as changed:
            versions = lambda name, package=package: f"9 {name == package}"  # noqa: E731
            changed.setattr("panchroma.tools.evaluation.cameras.package_version", versions)
            other[package] = name_of()
    with monkeypatch.context() as changed:
        changed.setattr(module, "source_digest", lambda: CHANGED)
        other["source"] = name_of()
    assert {"pattern.tile", "pattern.origin", "pattern.channels"} <= other.keys()
    assert len({name_of(), *other.values()}) == len(other) + 1


def test_a_picture_that_changes_once_listed_is_one_line_and_nothing_is_kept(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    todo = missing_cases(study, tmp_path)[0]
    assert works(study, tmp_path, todo[:1]) == []
    path = Path(study.scenes[0].source)
    before = path.read_bytes()
    np.save(path, small_scene(78, 90, 7))
    # a picture is listed as it is now
    assert study_of(tmp_path).scenes[0].digest != study.scenes[0].digest
    study.reading.scene(study.scenes[1])  # what was read of the first one is forgotten
    line = f"{path}: the picture has changed since the evaluation began; run it again"
    assert alone().measure(study, tmp_path, todo[1:]) == [line]
    assert len(collect(study, tmp_path)) == 1 + 6  # what was measured before is right
    with pytest.raises(InputError, match=r"scene0\.npy: the picture has changed"):
        render_exhibit(study, Crop(study.scenes[0], NOISY, WORST, ("paper",), 15, 15, 48, 60))
    path.write_bytes(before)  # a worker that has seen the other one takes it up again
    assert works(study, tmp_path, missing_cases(study, tmp_path)[0]) == []
    path.unlink()
    study.reading.scene(study.scenes[1])
    (line,) = alone().measure(study, tmp_path, todo)
    assert line.startswith(f"{path}: there is no such file")


def test_a_network_that_changes_is_one_line_and_its_content_alone_counts(tmp_path: Path) -> None:
    def written(folder: Path, weight: float, name: str = "mine") -> tuple[str, Study]:
        folder.mkdir(exist_ok=True)
        path = of_quads(folder, [weight, 0, 0, 0, 0], name, order="GRBG", inputs=QUADS)
        (method,) = registry.choose([path])
        return path, study_of(tmp_path, methods=(method.name,), sources=((method.name, path),))

    path, study = written(tmp_path / "one", 1)
    kept, todo = {case.name for case in study.cases()}, missing_cases(study, tmp_path)[0]
    assert works(study, tmp_path, todo[:1]) == []
    elsewhere = written(tmp_path / "two", 1, "renamed")[1]
    assert {case.name for case in elsewhere.cases()} == kept
    assert missing_cases(elsewhere, tmp_path)[1] == 1
    changed = written(tmp_path / "one", 0.5)[1]
    assert kept.isdisjoint(case.name for case in changed.cases())
    registry.find_method.cache_clear()  # as in another process
    (line,) = works(study, tmp_path, todo[1:2])
    assert line == f"{path}: has changed since the evaluation began; run it again"


def test_results_of_another_version_are_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A worker on another machine, or a package that was installed meanwhile."""
    study = study_of(tmp_path, methods=("dcb", "bilinear"))
    todo = missing_cases(study, tmp_path)[0]
    monkeypatch.setattr("panchroma.tools.evaluation.cameras.package_version", lambda _: "another")
    for line, name in zip(alone().measure(study, tmp_path, todo), study.methods, strict=True):
        assert line.startswith(f"{name}: the source of Panchroma has changed")


def test_only_what_is_missing_or_damaged_is_made(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    assert [len(missing_cases(study, tmp_path, anew=anew)[0]) for anew in (False, True)] == [12, 12]
    twice = replace(study, scenes=(study.scenes[0], replace(study.scenes[0], name="again")))
    assert len(missing_cases(twice, tmp_path)[0]) == 6  # equal scenes are measured once
    before = measured(study, tmp_path)
    assert missing_cases(study, tmp_path) == ([], 12)
    assert len(missing_cases(study, tmp_path, anew=True)[0]) == 12
    for index, path in enumerate(sorted((tmp_path / FOLDER).iterdir())[:3]):
        path.write_bytes([b"", b"PK\3\4 junk", path.read_bytes()[:-40]][index])
    todo, there = missing_cases(study, tmp_path)
    assert (len(todo), there) == (3, 9)
    np.testing.assert_equal(measured(study, tmp_path).rows, before.rows)


def test_one_failing_method_stops_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    methods = ("bilinear", "dlmmse", "preview")
    study = study_of(tmp_path, methods=methods, count=1, levels=(NOISY,))
    ends = (ConvergenceError("stopped at 500 iterations"), MemoryError(), Measures.of(*pair()))
    monkeypatch.setattr(Measures, "of", Mock(side_effect=ends))
    first, second = works(study, tmp_path, missing_cases(study, tmp_path)[0])
    assert first.endswith("scene0.npy: bilinear, sigma 0.03: stopped at 500 iterations")
    assert "dlmmse: not enough memory for a picture" in second
    assert len(collect(study, tmp_path)) == 1


# --- resume ---------------------------------------------------------------------------------------


def test_options_that_change_results_measure_them_again(tmp_path: Path, out: Path) -> None:
    codes = np.rint(small_scene(66, 72, 0) * 255).astype(np.uint8)
    Image.fromarray(codes).save(tmp_path / "scene.png")
    line = ("evaluate", tmp_path / "scene.png", "-o", out, "--methods preview,bilinear")
    usual = "--sigma 0.01 --crop 60 --jobs 1"
    run(*line, usual, code=0)
    for options, kept in (
        (usual, 2),
        ("--sigma 0.01 --crop 60 --jobs 2 --max-memory 8G", 2),
        ("--sigma 0.01 --crop 54", 0),
        ("--sigma 0.01 --crop 60 --linear", 0),
        ("--sigma 0.02 --crop 60", 0),
        ("--light 0.25 --crop 60", 0),
        ("--sigma 0.01 --crop 60 --pattern K=4", 1),
    ):
        listed = run(*line, options, "--resume --dry-run", code=0).out
        assert listed.endswith(f"{2 - kept} results to make, {kept} kept from an earlier run\n")


def test_the_source_is_all_that_can_be_imported_and_the_networks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "__file__", str(tmp_path / "tools/evaluation/study.py"))

    def digest_with(name: str, data: bytes = b"") -> str:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
        return source_digest.__wrapped__()

    before = digest_with("tools/batch/run.py")
    others = "tests/a.py", "tools/README.md", ".DS_Store", "shared/.DS_Store"
    copies = "tools/batch/._run.py", "tools/batch/run copy.py", "offline/models/._a.onnx"
    for name in (*others, *copies, "offline/models/loss.png", "tools/notebook/panchroma/a.py"):
        assert digest_with(name) == before, name
    network = "offline/models/a.onnx"
    sources = "tools/batch/run.py", "tools/new.py", "shared/a.py", "device/a.py", "offline/a.py"
    changed = [*((name, b"1") for name in sources), (network, b"1"), (network, b"2")]
    assert len({before, *(digest_with(*change) for change in changed)}) == 1 + len(changed)
