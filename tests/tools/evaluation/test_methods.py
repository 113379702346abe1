import numpy as np
import pytest

from shared import CfaPattern
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.evaluation import method as module
from tools.evaluation.cameras import CameraPair
from tools.evaluation.method import Method
from tools.evaluation.methods import choose, default_names, methods
from tools.evaluation.rivals.interpolation import demosaic_bilinear
from tools.io.versions import package_version
from tools.simulation.bayer import sample_bayer
from tools.simulation.noise import PaperProtocol

ASKED_FOR = "paper best unlearned preview bilinear malvar menon dlmmse ahd dcb dht aahd ea demosaicnet bm3d+menon bm3d+dlmmse"


def test_every_method_asked_for_is_there_by_name() -> None:
    assert set(methods()) >= set(ASKED_FOR.split())
    assert all(method.name == name for name, method in methods().items())
    assert [name for name, method in methods().items() if method.ours] == ["paper", "best", "unlearned", "preview"]


def test_methods_are_chosen_by_name_and_checked() -> None:
    assert [method.name for method in choose(["dlmmse", "paper", "dlmmse"])] == ["dlmmse", "paper"]
    with pytest.raises(InputError, match="unknown method 'magic'; there are paper, best"):
        choose(["magic"])


def test_a_method_without_its_package_is_left_out_and_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    known = {name: package_version(name) for name in ("colour-demosaicing", "rawpy")}
    monkeypatch.setattr(module, "package_version", lambda name: None if name == "bm3d" else known.get(name, "1"))
    assert "bm3d+menon" not in default_names()
    assert "menon" in default_names()
    with pytest.raises(InputError, match=r"bm3d\+menon needs the package bm3d: pip install -e '.\[rivals\]'"):
        choose(["bm3d+menon"])


def test_balanced_methods_see_white_as_grey() -> None:
    """Under a coloured light the samples are divided by what white reads, and the picture multiplied by it."""
    seen: list[FloatArray] = []

    def spy(samples: FloatArray) -> FloatArray:
        seen.append(samples)
        return demosaic_bilinear(samples)

    rgb = np.broadcast_to(np.array([0.3, 0.6, 0.15], np.float32), (30, 30, 3))
    cameras = CameraPair(PaperProtocol(0.0), 0, rgb, CfaPattern.bayer(6), (0.5, 1.0, 0.25))
    picture = Method("spy", "", spy, balanced=True).render(cameras)
    np.testing.assert_allclose(seen[0], 0.6, atol=1e-6)
    np.testing.assert_allclose(picture, rgb, atol=1e-6)
    Method("spy", "", spy).render(cameras)
    np.testing.assert_array_equal(seen[1], sample_bayer(rgb))


def test_methods_that_denoise_share_the_denoised_samples() -> None:
    calls: list[tuple[float, float]] = []

    def darken(samples: FloatArray, shot: float, read: float) -> FloatArray:
        calls.append((shot, read))
        return samples * np.float32(0.5)

    rgb = np.full((30, 30, 3), 0.4, np.float32)
    cameras = CameraPair(PaperProtocol(0.0), 0, rgb, CfaPattern.bayer(6), None)
    for _ in range(2):
        picture = Method("spy", "", demosaic_bilinear, denoise=darken).render(cameras)
        np.testing.assert_allclose(picture, rgb / 2, atol=1e-6)
    assert calls == [(0.0, 0.0)]
    np.testing.assert_allclose(Method("plain", "", demosaic_bilinear).render(cameras), rgb, atol=1e-6)
