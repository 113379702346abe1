from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from offline import PAPER, render
from offline.version import ALGORITHM
from shared import SensorCalibration
from shared.errors import InputError
from shared.pattern import CfaPattern
from tests.bayer import bayer_mosaic
from tests.tools.evaluation.examples import alone, measured, small_scene, study_of
from tests.tools.evaluation.rivals.test_network import QUADS, of_quads
from tests.walking import CHANGED, one_field_changed
from tools.batch.console import Console
from tools.evaluation import methods as registry
from tools.evaluation import study as module
from tools.evaluation.metrics import QUANTILES, patch_psnr, quality, whole_psnr
from tools.evaluation.page.gallery import Crop, render_exhibit
from tools.evaluation.rivals.interpolation import demosaic_bilinear
from tools.evaluation.study import FOLDER, Study, collect, tasks, work
from tools.evaluation.team import Team, needed_memory
from tools.simulation.noise import PaperProtocol, SensorProtocol
from tools.simulation.sensor import simulate_additive

NOISY = PaperProtocol(0.03)


def whole(study: Study) -> Crop:
    """All of the first scene but its border."""
    return Crop(study.scenes[0], NOISY, 15, 15, 48, 60, "")


def test_figures_are_those_of_simulating_rendering_and_measuring_by_hand(tmp_path: Path) -> None:
    figures = measured(study_of(tmp_path), tmp_path)
    maps = []
    for seed in range(2):
        truth = small_scene(78, 90 + 12 * seed, seed)
        bayer = demosaic_bilinear(bayer_mosaic(truth, 0.03, np.random.default_rng(0)))
        mosaic = simulate_additive(truth, CfaPattern.bayer(6), SensorCalibration(), 0.03, np.random.default_rng(0))
        sparse = render(mosaic, PAPER).rgb
        for name, picture in (("bilinear", bayer), ("paper", sparse)):
            place = f"scene{seed}", NOISY, name
            (found,) = (each for cell, each in figures.results.items() if (cell.scene.name, cell.level, cell.method) == place)
            assert found.quality == quality(picture, truth)
            assert found.psnr == whole_psnr(picture, truth, 15)
        maps.append(patch_psnr(sparse, truth))
    pooled = figures.sets[0].figure(NOISY, "paper")
    for plane, name in enumerate(("rgb", "luminance", "chrominance")):
        expected = np.quantile(np.concatenate([each[plane].ravel() for each in maps]), QUANTILES)
        assert [pooled.values[f"{name}_q{round(100 * each)}"] for each in QUANTILES] == pytest.approx(expected, abs=0.01)


def test_finished_results_are_not_made_again(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    todo, there = tasks(study, tmp_path)
    assert (len(todo), there) == (12, 0)
    for task in todo[:5]:  # and here it is interrupted
        work(task)
    todo, there = tasks(study, tmp_path)
    assert (len(todo), there) == (7, 5)
    for task in todo:
        work(task)
    assert tasks(study, tmp_path) == ([], 12)


def test_everything_that_changes_a_result_changes_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = study_of(tmp_path, methods=("paper",), count=1)
    scene, method, tile = study.scenes[0], registry.methods()["menon-wb"], study.tile
    whole = study.cell(scene, NOISY, method, tile).name
    other: dict[str, str] = {"seed": replace(study, seed=1).cell(scene, NOISY, method, tile).name}
    # Without noise any seed is the same, and so is a pattern under another name.
    quiet, same = PaperProtocol(0.0), replace(tile, name="mine")
    assert replace(study, seed=1).cell(scene, quiet, method, same).name == study.cell(scene, quiet, method, tile).name
    for level in (PaperProtocol(0.02), SensorProtocol(0.03)):
        other[str(level)] = study.cell(scene, level, method, tile).name
    for name, pattern in one_field_changed(tile.pattern):
        other[f"pattern.{name}"] = study.cell(scene, NOISY, method, replace(tile, pattern=pattern)).name
    for name in ("digest", "neutral", "channels"):
        other[name] = study.cell(replace(scene, **{name: CHANGED}), NOISY, method, tile).name  # type: ignore[arg-type]
    for name, change in {"name": "menon", "version": 2, "balanced": False, "packages": ("numpy",)}.items():
        other[name] = study.cell(scene, NOISY, replace(method, **{name: change}), tile).name  # type: ignore[arg-type]
    for place, name in ((PaperProtocol, "version"), (module, "MEASURING")):
        with monkeypatch.context() as changed:
            changed.setattr(place, name, 99)
            other[f"{place} {name}"] = study.cell(scene, NOISY, method, tile).name
    assert {"pattern.tile", "pattern.origin", "pattern.channels", "channels"} <= other.keys()
    assert len({whole, *other.values()}) == len(other) + 1
    of_ours = {str(registry.methods()[name].version) for name in ("paper", "best", "unlearned", "preview")}
    assert len(of_ours) == 4
    assert sum(each.startswith(f"[{ALGORITHM}, ") for each in of_ours) == 3


def test_a_picture_that_changes_after_it_was_listed_is_one_line_and_nothing_is_kept(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    for task in (todo := tasks(study, tmp_path)[0])[:1]:
        work(task)
    path = Path(study.scenes[0].source)
    before = path.read_bytes()
    np.save(path, small_scene(78, 90, 7))
    study.reading.info(study.scenes[1].source)  # what was read of the first one is forgotten
    assert alone().measure(todo[1:]) == [f"{path}: the picture has changed since the evaluation began; run it again"]
    assert {cell.scene.name for cell in collect(study, tmp_path)} == {"scene0", "scene1"}  # what was measured before is right
    assert len(collect(study, tmp_path)) == 1 + 6
    with pytest.raises(InputError, match=r"scene0\.npy: the picture has changed"):
        render_exhibit(study, (whole(study), ("paper",)))
    path.write_bytes(before)  # a worker that has seen the other one takes it up again
    assert [line for task in tasks(study, tmp_path)[0] for line in work(task)] == []
    path.unlink()
    study.reading.info(study.scenes[1].source)
    (line,) = alone().measure(todo)
    assert line.startswith(f"{path}: there is no such file")


def test_a_picture_is_listed_as_it_is_now(tmp_path: Path) -> None:
    before = study_of(tmp_path, count=1).scenes[0]
    np.save(before.source, small_scene(78, 90, 7))
    assert study_of(tmp_path, count=1).scenes[0].digest != before.digest


def test_a_network_that_changes_is_one_line_and_results_depend_on_its_content_alone(tmp_path: Path) -> None:
    def written(folder: Path, weight: float, name: str = "mine") -> tuple[str, Study]:
        folder.mkdir(exist_ok=True)
        path = of_quads(folder, [weight, 0, 0, 0, 0], order="GRBG", inputs=QUADS)
        for end in (".onnx", ".json"):
            Path(path).with_suffix(end).rename(folder / f"{name}{end}")
        path = str(folder / f"{name}.onnx")
        (method,) = registry.choose([path])
        return path, study_of(tmp_path, methods=(method.name,), networks=((method.name, path),))

    path, study = written(tmp_path / "one", 1)
    kept = {cell.name for cell in study.cells()}
    todo = tasks(study, tmp_path)[0]
    assert work(todo[0]) == []
    other, changed = written(tmp_path / "one", 0.5)
    assert not kept & {cell.name for cell in changed.cells()}
    assert changed.methods != study.methods
    assert all(name.startswith("mine-") and "/" not in name for name in (*study.methods, *changed.methods))
    (line,) = alone().measure(todo)
    assert line == f"{other}: has changed since the evaluation began; run it again"
    first = tasks(changed, tmp_path)[0][0]
    registry.methods().networks.clear()  # as in another process
    assert work(first) == []
    elsewhere = written(tmp_path / "two", 1, "renamed")[1]
    assert {cell.name for cell in elsewhere.cells()} == kept
    assert tasks(elsewhere, tmp_path)[1] == 1
    for end in (".json", ".onnx"):
        Path(path).with_suffix(end).unlink()
        (line,) = alone().measure(tasks(changed, tmp_path)[0])
        assert line.startswith(f"{Path(path).with_suffix(end)}: ")


def test_results_of_another_version_are_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A worker on another machine, or a package that was installed meanwhile."""
    todo = tasks(study_of(tmp_path, methods=("menon", "bilinear")), tmp_path)[0]
    monkeypatch.setattr("tools.evaluation.method.package_version", lambda name: "another")
    (line,) = alone().measure(todo)
    assert line.startswith("menon: the process that measures has other versions of Panchroma, colour-demosaicing")


def test_every_method_of_ours_can_represent_us(tmp_path: Path) -> None:
    for name, method in registry.methods().items():
        assert study_of(tmp_path, methods=("bilinear", name)).ours == (name if method.ours else None)


def test_a_damaged_result_is_made_again(tmp_path: Path) -> None:
    study = study_of(tmp_path)
    before = measured(study, tmp_path)
    for index, path in enumerate(sorted((tmp_path / FOLDER).iterdir())[:3]):
        path.write_bytes([b"", b"junk", path.read_bytes()[:-30]][index])
    todo, there = tasks(study, tmp_path)
    assert (len(todo), there) == (3, 9)
    after = measured(study, tmp_path)
    assert list(after.rows) == list(before.rows)


def test_one_failing_method_stops_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from shared.errors import ConvergenceError

    study = study_of(tmp_path, methods=("bilinear", "dlmmse"))
    genuine = module.render_cell

    def failing(cell, seed, reading):  # type: ignore[no-untyped-def]
        if cell.method == "dlmmse" and cell.scene.name == "scene1":
            raise ConvergenceError("stopped at 500 iterations")
        return genuine(cell, seed, reading)

    monkeypatch.setattr(module, "render_cell", failing)
    lines = [line for task in tasks(study, tmp_path)[0] for line in work(task)]
    assert lines[0].endswith("scene1.npy: dlmmse, no noise: stopped at 500 iterations")
    assert len(lines) == 2
    assert len(collect(study, tmp_path)) == 6


def test_methods_that_share_their_denoising_are_one_task(tmp_path: Path) -> None:
    names = tuple(name for name, method in registry.methods().items() if method.denoise and method.missing is None)
    if not names:
        pytest.skip("the extra `rivals` is not installed")
    todo, _ = tasks(study_of(tmp_path, methods=(*names, "bilinear")), tmp_path)
    assert sorted(len(task.cells) for task in todo) == sorted([len(names)] * 4 + [1] * 4)


def test_processes_share_the_memory() -> None:
    one = needed_memory(10**6)
    assert one == 250 * 2**20 + 400 * 10**6
    assert [Team(Console(), 4, memory).processes(10**6) for memory in (one - 1, one, 3 * one, 100 * one)] == [1, 1, 3, 4]
