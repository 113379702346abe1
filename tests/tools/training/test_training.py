"""A short training: it learns, goes on where it stopped, and writes what the render runs. Needs PyTorch, which CI has not."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from offline.rows.learned import _session
from shared.errors import InputError
from shared.progress import SILENT
from tests.data import ROOT
from tools.pictures.samples import quantise
from tools.scenes.load import load_scene

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'panchroma[training]'")
pytest.importorskip("onnxscript", reason="onnxscript is not installed: pip install 'panchroma[training]'")

from tools.training import run  # noqa: E402
from tools.training.graph import TILE, Corrector, save_graph  # noqa: E402
from tools.training.network import HALO, Network  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")


@pytest.fixture(scope="module")
def photographs(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, ...]:
    """Twenty-one small pictures."""
    from PIL import Image

    folder = tmp_path_factory.mktemp("photographs")
    scene = load_scene("builtin:420x280").rgb
    for number in range(21):
        row, column = 4 * number, 9 * number
        Image.fromarray(quantise(scene[row : row + 120, column : column + 130] ** (1 / 2.2), 8).astype(np.uint8)).save(
            folder / f"{number:02d}.png"
        )
    return tuple(str(path) for path in sorted(folder.iterdir()))


def small(photographs: tuple[str, ...], steps: int) -> run.Plan:
    return run.Plan(photographs, 4, steps, batch=2, variants=1, patch=6)


def test_it_learns_and_writes_what_the_render_runs(photographs: tuple[str, ...], tmp_path: Path) -> None:
    said: list[str] = []
    path = run.train(small(photographs, 120), tmp_path, 1, SILENT, said.append)
    assert said
    assert said[-1].startswith("step 120: left 0.")
    assert _session(path).get_inputs()
    history = json.loads((tmp_path / "k4" / "plan.json").read_text())
    assert history["steps"] == 120


def test_an_interrupted_training_ends_with_the_same_weights(
    photographs: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_REPORT", 2)
    plan, folders = small(photographs, 6), [tmp_path / name for name in ("whole", "parted")]
    for folder in folders:
        folder.mkdir()
    expected = run.train(plan, folders[0], 1, SILENT, lambda _: None).read_bytes()

    def interrupt(text: str) -> None:
        if text.startswith("step 4"):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run.train(plan, folders[1], 1, SILENT, interrupt)
    steps: list[str] = []
    assert run.train(plan, folders[1], 1, SILENT, steps.append).read_bytes() == expected
    assert [each.split(":")[0] for each in steps] == ["step 4", "step 6"]


def test_another_training_does_not_go_on_in_the_same_folder(photographs: tuple[str, ...], tmp_path: Path) -> None:
    run.train(small(photographs, 1), tmp_path, 1, SILENT, lambda _: None)
    with pytest.raises(InputError, match="holds another training"):
        run.train(small(photographs, 2), tmp_path, 1, SILENT, lambda _: None)


def test_the_file_computes_what_the_network_does(tmp_path: Path) -> None:
    import onnxruntime

    torch.manual_seed(1)
    network = Network(4)
    for parameter in network.parameters():
        torch.nn.init.normal_(parameter, std=0.03)
    path = tmp_path / "rggb-k4.onnx"
    save_graph(network, path, {"fact": "one"})
    side, random = TILE + 2 * HALO, np.random.default_rng(0)
    inputs = {
        "picture": random.uniform(0, 1, (1, 3, side * 4, side * 4)).astype(np.float32),
        "error": random.normal(0, 0.05, (1, 4, side, side)).astype(np.float32),
        "variance": np.full((1, 1, side, side), 1e-5, np.float32),
    }
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (found,) = session.run(None, inputs)
    with torch.no_grad():
        expected = Corrector(network)(*(torch.from_numpy(each) for each in inputs.values())).numpy()
    assert found.shape == (1, 3, TILE * 4, TILE * 4)
    assert np.abs(found - expected).max() < 2e-3 * np.abs(expected).max()  # weights of 16 bits
    assert np.abs(found.sum(axis=1)).max() < 1e-5  # luminance stays
    assert session.get_modelmeta().custom_metadata_map == {"fact": "one"}


def test_the_file_corrects_nothing_where_nothing_is(tmp_path: Path) -> None:
    """The exporter must not drop what keeps activity from being 0."""
    import onnxruntime

    network = Network(4)
    torch.nn.init.normal_(network.leave.bias)
    save_graph(network, tmp_path / "rggb-k4.onnx", {})
    session = onnxruntime.InferenceSession(tmp_path / "rggb-k4.onnx", providers=["CPUExecutionProvider"])
    for light in (0.0, 0.3):
        inputs = {
            each.name: np.full(each.shape, light if each.name == "picture" else 0, np.float32) for each in session.get_inputs()
        }
        (found,) = session.run(None, inputs)
        assert np.abs(found).max() < 1e-5


def test_too_small_and_too_few_pictures_are_refused(photographs: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(InputError, match="too small to learn from"):
        run.train(run.Plan(photographs, 4, 1, variants=1, patch=200), tmp_path, 1, SILENT, lambda _: None)
    few = subprocess.run(
        [sys.executable, "-m", "tools.training", str(tmp_path), "-o", str(tmp_path / "out")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert few.returncode == 2
    assert "0 photographs found; at least 20 are needed" in few.stderr
