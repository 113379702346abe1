import numpy as np
import pytest

from panchroma.shared import CfaPattern
from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import InputError
from panchroma.tools.evaluation import cameras as module
from panchroma.tools.evaluation.cameras import CameraPair, with_balance
from panchroma.tools.evaluation.methods import choose, default_names, methods
from panchroma.tools.evaluation.rivals.bilinear import demosaic_bilinear
from panchroma.tools.io.versions import package_version
from panchroma.tools.simulation.bayer import sample_bayer
from panchroma.tools.simulation.protocols import PaperProtocol

NAMES = "paper best unlearned preview bilinear dlmmse dlmmse-wb dcb bm3d+dlmmse-wb"


def test_methods_are_chosen_by_name_and_checked() -> None:
    assert list(methods()) == NAMES.split()
    assert [name for name, method in methods().items() if method.ours] == NAMES.split()[:4]
    assert [method.name for method in choose(["dlmmse", "paper", "dlmmse"])] == ["dlmmse", "paper"]
    message = "unknown method 'menon'; there are paper, best, unlearned.*dcb.*networks"
    with pytest.raises(InputError, match=message):
        choose(["menon"])


def test_a_method_without_its_package_is_left_out_and_refused_by_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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

    picture = with_balance(check_grey, sample_bayer(rgb), cameras.white)
    np.testing.assert_allclose(picture, rgb, atol=1e-6)
    for name in ("bilinear", "dlmmse", "dlmmse-wb", "dcb"):
        picture = methods()[name].render(cameras)
        np.testing.assert_allclose(picture[8:-8, 8:-8], rgb[8:-8, 8:-8], atol=4e-5)
