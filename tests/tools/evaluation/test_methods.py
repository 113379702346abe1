import numpy as np
import pytest

from offline import BEST, PAPER
from shared.arrays import FloatArray
from shared.errors import InputError
from tools.evaluation import methods as module
from tools.evaluation.methods import Method, choose, default_names, methods, render_bayer, render_sparse
from tools.evaluation.protocol import BayerShot, Protocol
from tools.evaluation.rivals import demosaic_bilinear
from tools.host.versions import package_version

ASKED_FOR = {"paper", "best", "preview", "bilinear", "malvar", "menon", "dlmmse", "ahd", "dcb", "dht", "aahd", "ea"}
LOW_LIGHT = {"bm3d+menon", "bm3d+dlmmse"}


def test_every_method_asked_for_is_there_by_name() -> None:
    assert set(methods()) >= ASKED_FOR | LOW_LIGHT
    assert all(method.name == name for name, method in methods().items())
    assert [name for name, method in methods().items() if method.ours] == ["paper", "best", "preview"]


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


def test_best_is_a_default_only_where_it_differs_from_the_paper() -> None:
    assert ("best" in default_names()) == (BEST != PAPER)
    same = methods()["best"].identity() == methods()["paper"].identity()
    assert same == (BEST == PAPER)


def test_identities_tell_apart_what_differs() -> None:
    identities = {name: method.identity() for name, method in methods().items() if name != "best"}
    assert len(set(identities.values())) == len(identities)


def test_balanced_methods_see_white_as_grey() -> None:
    """Under a coloured light the samples are divided by what white reads, and the picture multiplied by it."""
    seen: list[FloatArray] = []

    def spy(samples: FloatArray, order: str) -> FloatArray:
        seen.append(samples)
        return demosaic_bilinear(samples, order)

    rgb = np.broadcast_to(np.array([0.3, 0.6, 0.15], np.float32), (30, 30, 3))
    shot = Protocol().bayer_shot(rgb, 0.0)
    picture = render_bayer(Method("spy", "", demosaic=spy, balanced=True), shot, (0.5, 1.0, 0.25))
    np.testing.assert_allclose(seen[0], 0.6, atol=1e-6)
    np.testing.assert_allclose(picture, rgb, atol=1e-6)
    render_bayer(Method("spy", "", demosaic=spy), shot, (0.5, 1.0, 0.25))
    np.testing.assert_array_equal(seen[1], shot.samples)


def test_each_camera_has_its_own_methods() -> None:
    shot = BayerShot(np.zeros((30, 30), np.float32), 0, 0)
    with pytest.raises(InputError, match="sparse"):
        render_bayer(methods()["paper"], shot, None)
    mosaic = Protocol().sparse_shot(np.zeros((30, 30, 3), np.float32), 0, 6)
    with pytest.raises(InputError, match="Bayer"):
        render_sparse(methods()["bilinear"], mosaic, 1.0)


@pytest.mark.parametrize("name", ["paper", "preview"])
@pytest.mark.parametrize("period", [4, 6])
def test_ours_give_a_flat_scene_back_in_scene_units(name: str, period: int) -> None:
    rgb = np.broadcast_to(np.array([0.2, 0.4, 0.3], np.float32), (48, 54, 3))
    for protocol, level, tolerance in ((Protocol(), 0.0, 2e-3), (Protocol("sensor"), 0.5, 0.02)):
        shot = protocol.sparse_shot(rgb, level, period)
        picture = render_sparse(methods()[name], shot, protocol.gain(level))
        np.testing.assert_allclose(picture.mean(axis=(0, 1)), rgb[0, 0], atol=tolerance)
