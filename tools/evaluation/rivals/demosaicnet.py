"""A learned demosaicker: Gharbi, Chaurasia, Paris and Durand, "Deep Joint Demosaicking and Denoising" (SIGGRAPH Asia 2016).

The package `demosaicnet` (MIT) has the authors' weights for noise-free Bayer mosaics. Its own code imports a part of setuptools
that is no more, so the network, fifteen convolutions on quads and one on pixels, is written down here again.
"""

from functools import cache
from importlib.metadata import distribution
from typing import Any

import numpy as np

from shared.arrays import ByteArray, FloatArray

from ..method import Method
from .network import in_pieces

_LAYERS, _WIDTH = 15, 64
_MARGIN = 40  # pixels: more than the network sees around each one, and even
_GAMMA = 2.2  # it has learned from pictures as screens show them


def demosaic_demosaicnet(mosaic: FloatArray) -> FloatArray:
    """The network's picture, float32 (H, W, 3), of a Bayer mosaic (H, W), both in scene units, 1 = white."""
    import torch

    def run(codes: FloatArray, filters: ByteArray) -> FloatArray:
        planes = (codes * (filters == np.arange(3)[:, None, None])).astype(np.float32)
        with torch.no_grad():
            found: FloatArray = _network(torch.from_numpy(planes[None]))[0].numpy()
        return found

    codes = np.sign(mosaic) * np.abs(mosaic) ** np.float32(1 / _GAMMA)
    picture = in_pieces((codes,), "GRBG", _MARGIN, run).astype(np.float32)
    return np.ascontiguousarray(np.sign(picture) * np.abs(picture) ** np.float32(_GAMMA))


def _network(mosaic: Any) -> Any:
    """(1, 3, h, w), zeros where a channel was not measured, order GRBG -> (1, 3, h - 62, w - 62)."""
    from torch.nn import functional

    weights = _weights()

    def convolved(values: Any, name: str, **options: Any) -> Any:
        return functional.conv2d(values, weights[f"{name}.weight"], weights[f"{name}.bias"], **options)

    found = convolved(mosaic, "main_processor.pack_mosaic", stride=2)
    for layer in range(1, _LAYERS + 1):
        found = functional.relu(convolved(found, f"main_processor.conv{layer}"))
    residual = convolved(found[:, :_WIDTH] * found[:, _WIDTH:], "residual_predictor")
    upsampled = functional.conv_transpose2d(residual, weights["upsampler.weight"], weights["upsampler.bias"], stride=2, groups=3)
    edge = (mosaic.shape[2] - upsampled.shape[2]) // 2
    cropped = mosaic[:, :, edge : edge + upsampled.shape[2], edge : edge + upsampled.shape[3]]
    import torch

    full = functional.relu(convolved(torch.cat([cropped, upsampled], 1), "fullres_processor.post_conv"))
    return convolved(full, "fullres_processor.output")


@cache
def _weights() -> dict[str, Any]:
    import torch

    path = distribution("demosaicnet").locate_file("demosaicnet/data/bayer.pth")
    return dict(torch.load(str(path), map_location="cpu", weights_only=True))


_TITLE, _PACKAGES = "Bayer, Gharbi 2016, balanced", ("demosaicnet", "torch")
METHODS = (Method("demosaicnet", _TITLE, demosaic_demosaicnet, balanced=True, packages=_PACKAGES, seconds=8),)
