"""Somebody's own function as a method: how it is found, what it may return, and what is said where
it fails.
"""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern, FloatArray, InputError
from panchroma.tools.evaluation import cameras as module
from panchroma.tools.evaluation import methods as registry
from panchroma.tools.evaluation.cameras import CameraPair, render_samples
from panchroma.tools.evaluation.methods import choose, default_names, methods
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.evaluation.study import work
from panchroma.tools.io.versions import package_version
from panchroma.tools.simulation.protocols import PaperProtocol
from panchroma.tools.training.graph import Graph
from tests.data import ROOT
from tests.tools.command import spawn
from tests.tools.evaluation.examples import small_scene, study_of

# --- functions ------------------------------------------------------------------------------------

README = ROOT / "tools" / "evaluation" / "README.md"
SPARSE = """from panchroma.offline import PAPER, render
import numpy as np


def mine(mosaic):
    return render(mosaic, PAPER).rgb


"""


@pytest.fixture
def written(tmp_path: Path) -> Path:
    (tmp_path / "mine.py").write_text(SPARSE)
    return tmp_path / "mine.py"


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("raise SystemExit(3)", "line 10: SystemExit: 3"),
        ("return render(mosaic, PAPER)", "returned Rendering, expected an array (60, 66, 3)"),
        ("return mosaic.signal", "returned (60, 66), expected an array (60, 66, 3)"),
        ("return mine(mosaic).transpose(1, 0, 2)", "returned (66, 60, 3), expected an array"),
        ("return (mine(mosaic) * 9).astype(np.uint16)", "a picture of uint16, expected floating"),
        ("return mine(mosaic) * np.nan", "11880 of 11880 values of the picture are not finite"),
        ("return render(mosaic, 7).rgb", "line 10: settings is 7, expected RenderSettings"),
    ],
)
def test_what_is_wrong_with_a_function_is_said_with_file_function_and_scene(
    tmp_path: Path, written: Path, body: str, said: str
) -> None:
    np.save(tmp_path / "scene0.npy", small_scene(60, 66, 0))
    written.write_text(f"{SPARSE}def wrong(mosaic):\n    {body}\n")
    (method,) = registry.choose([f"{written}:wrong"])
    levels, sources = PaperProtocol.levels((0.01,)), ((method.name, f"{written}:wrong"),)
    study = study_of(tmp_path, (method.name,), 1, levels=levels, sources=sources)
    (line,) = work(study, tmp_path, next(study.cases()))
    assert line.startswith(f"{tmp_path}/scene0.npy: mine.wrong-")
    assert f", sigma 0.01: {written}:wrong" in line
    assert said in line
    assert "\n" not in line


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        (SPARSE, "mien", "mine.py:mien: there is no function 'mien'; did you mean mine?"),
        (SPARSE + "number = 3", "number", "there is no function 'number'$"),
        (SPARSE, "", "there is no function ''"),
        ("def f(:", "f", "SyntaxError: .*line 1"),
        ("\nimport nowhere_at_all", "f", "line 2: ModuleNotFoundError: No module named"),
        ("\n\nraise SystemExit('no')", "f", "line 3: SystemExit: no"),
        ("from . import other", "f", "line 1: ImportError"),
        ("\0", "f", "mine.py:f: SyntaxError|ValueError"),
    ],
)
def test_a_file_without_the_function_is_refused_by_name(
    written: Path, text: str, name: str, said: str
) -> None:
    written.write_text(text)
    with pytest.raises(InputError, match=said) as caught:
        registry.choose([f"{written}:{name}"])
    assert str(caught.value).startswith(str(written))
    written.unlink()
    with pytest.raises(InputError, match=r"mine\.py: there is no such file"):
        registry.choose([f"{written}:mine"])


def test_a_module_that_python_does_not_find_is_refused() -> None:
    for text in ("nowhere_at_all:f", "nowhere_at_all.below:f"):
        with pytest.raises(InputError, match=rf"{text}: no such module; .*PYTHONPATH"):
            registry.choose([text])
    for text in ("math:nothing", "math:"):
        with pytest.raises(InputError, match=f"{text}: there is no function"):
            registry.choose([text])
    with pytest.raises(InputError, match=r"functions by FILE\.py:FUNCTION or MODULE:FUNCTION"):
        registry.choose(["mine.py"])


def name_of(text: str) -> str:
    (method,) = registry.choose([text])
    return method.name


def test_results_depend_on_all_that_a_file_is_made_of(tmp_path: Path, written: Path) -> None:
    (tmp_path / "weights").mkdir()
    away = tmp_path / "weights" / "away.bin"
    texts = f"BESIDE = 'beside.npy'\nBELOW = \"weights/below.npz\"\nAWAY = {str(away)!r}"
    parts = [tmp_path / "beside.npy", tmp_path / "weights" / "below.npz", away]
    parts += [tmp_path / "helper.py", written]
    for path in parts:
        path.write_text(SPARSE + texts)
    names = [name_of(f"{written}:mine")]
    (tmp_path / "picture.png").write_bytes(b"not named in the source")
    (tmp_path / ".#mine.py").symlink_to("nowhere")  # as editors leave
    (tmp_path / "empty.py").touch()
    assert name_of(f"{written}:mine") == names[0]
    for path in parts:
        path.write_text(f"{SPARSE}{texts}\nGAIN = 1")
        names.append(name_of(f"{written}:mine"))
    assert len(set(names)) == len(names) == 6


def test_a_file_edited_with_its_size_and_time_runs_as_it_is(tmp_path: Path, written: Path) -> None:
    """Python's own cache knows sources by second and size."""
    scene, pattern = small_scene(48, 48, 0), CfaPattern.bayer(6)
    cameras = CameraPair(PaperProtocol(0.0), 0, scene, pattern, None)
    pictures = []
    for gain in (1, 2):
        written.write_text(SPARSE.replace(".rgb", f".rgb * {gain}"))
        os.utime(written, (1e9, 1e9))
        (method,) = registry.choose([f"{written}:mine"])
        pictures.append(method.render(cameras))
    np.testing.assert_array_equal(pictures[1], 2 * pictures[0])


def test_a_module_depends_on_its_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for plain in (True, False):  # with and without __init__.py
        package = tmp_path / f"own_{plain}"
        (package / "deep").mkdir(parents=True)
        if plain:
            (package / "__init__.py").write_text("")
        (package / "methods.py").write_text(f"from .deep.gains import GAIN\n{SPARSE}")
        (package / "deep" / "gains.py").write_text("GAIN = 1")
        monkeypatch.syspath_prepend(str(tmp_path))
        before = name_of(f"{package.name}.methods:mine")
        assert before.startswith(f"{package.name}.methods.mine-")
        (package / "deep" / "gains.py").write_text("GAIN = 2")
        assert name_of(f"{package.name}.methods:mine") != before


def test_the_example_of_the_page_runs_in_several_processes(tmp_path: Path, out: Path) -> None:
    """Own stage, own settings, own network; from another folder, by workers, with figures that are
    those of the same calls by hand.
    """
    (example,) = re.findall(r"```python\n# mine.py\n(.*?)```", README.read_text(), re.DOTALL)
    assert sum(map(bool, example.splitlines())) < 20
    (folder := tmp_path / "work").mkdir()
    (folder / "mine.py").write_text(example)
    graph = Graph()
    graph.store("w", np.full((3, 1, 3, 3), 1 / 27, np.float32))
    graph.add("Conv", ["mosaic", "w"], "y", pads=[1, 1, 1, 1])
    graph.write(folder / "mine.onnx", ("mosaic", [1, 1, "h", "w"]), ("y", [1, 3, "h", "w"]))
    np.save(tmp_path / "a.npy", small_scene(60, 66, 0))
    np.save(tmp_path / "b.npy", small_scene(66, 60, 1))
    mine = ",".join(f"{folder}/mine.py:{name}" for name in ("stage", "settings", "network"))
    scenes = tmp_path / "a.npy", tmp_path / "b.npy"
    options = f"--jobs 2 --sigma 0 --methods={mine},best,bilinear"
    spawn("evaluate", *scenes, "-o", out, options, code=0)
    document = json.loads((out / "evaluation.json").read_text())
    names = list(document["methods"])
    of_page = [name.rpartition("-")[0] for name in names[:3]]
    assert of_page == ["mine.stage", "mine.settings", "mine.network"]
    rows = [row for row in document["figures"] if row["scene"]]
    figures = {(row["method"], row["scene"]): row["psnr"] for row in rows}
    assert len(figures) == 10
    # half the denoising changes little, a grey picture loses colour, a blurred mosaic most
    for scene in "ab":
        stage, settings, network, best = (figures[name, scene] for name in names[:4])
        assert network < stage < best
        assert settings > stage
    assert str(folder) not in (out / "evaluation.html").read_text()


# --- methods --------------------------------------------------------------------------------------

NAMES = "paper best unlearned preview bilinear dlmmse dlmmse-wb dcb bm3d+dlmmse-wb"


def test_methods_are_chosen_by_name_and_checked() -> None:
    assert list(methods()) == NAMES.split()
    assert [name for name, method in methods().items() if method.ours] == NAMES.split()[:4]
    assert [method.name for method in choose(["dlmmse", "paper", "dlmmse"])] == ["dlmmse", "paper"]
    message = "unknown method 'menon'; there are paper, best, unlearned.*dcb.*networks"
    with pytest.raises(InputError, match=message):
        choose(["menon"])


def test_a_method_without_package_is_left_out_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    known = package_version("rawpy")
    monkeypatch.setattr(module, "package_version", lambda name: None if name == "bm3d" else known)
    assert default_names() == NAMES.split()[:-1]
    message = r"bm3d\+dlmmse-wb needs the package bm3d: pip install bm3d"
    with pytest.raises(InputError, match=message):
        choose(["bm3d+dlmmse-wb"])


def test_balanced_methods_see_white_as_grey() -> None:
    """Under a coloured light the samples are divided by what white reads, and the picture
    multiplied by it.
    """
    rgb = np.broadcast_to(np.array([0.3, 0.6, 0.15], np.float32), (30, 30, 3))
    cameras = CameraPair(PaperProtocol(0.0), 0, rgb, CfaPattern.bayer(6), (0.5, 1.0, 0.25))

    def check_grey(samples: FloatArray) -> FloatArray:
        np.testing.assert_allclose(samples, 0.6, atol=1e-6)
        return demosaic_bilinear(samples)

    picture = render_samples(check_grey, cameras.bayer, cameras.white)
    np.testing.assert_allclose(picture, rgb, atol=1e-6)
    for name in ("bilinear", "dlmmse", "dlmmse-wb", "dcb"):
        picture = methods()[name].render(cameras)
        np.testing.assert_allclose(picture[8:-8, 8:-8], rgb[8:-8, 8:-8], atol=4e-5)
