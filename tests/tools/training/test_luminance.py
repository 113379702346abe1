"""Learning what corrects filled luminance. Needs PyTorch, which CI has not."""

from pathlib import Path

import numpy as np
import pytest

from offline.whole.filling import SIDE
from shared.runtime import session

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'panchroma[training]'")

from tools.training.examples import DRAWN  # noqa: E402
from tools.training.luminance import examples, learn, save  # noqa: E402


@pytest.mark.parametrize("sites", [3, 4])
def test_it_learns_and_writes_what_the_render_runs(sites: int, tmp_path: Path) -> None:
    sources, said = [DRAWN] * 11, list[str]()  # the last one is kept back
    network = learn([examples(source, number, sites) for number, source in enumerate(sources)], sources, 150, said.append)
    assert 0.5 < float(said[-1].split()[3]) < 0.99
    save(network, tmp_path / "luminance.onnx")
    seen = np.random.default_rng(0).normal(size=(5, SIDE**2 + 1)).astype(np.float32)
    (found,) = session(tmp_path / "luminance.onnx").run(None, {"seen": seen})
    assert found.shape == (5, sites)
    assert found == pytest.approx(network(torch.from_numpy(seen)).detach().numpy(), abs=1e-4)
