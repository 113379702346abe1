"""Lossless JPEG: two decoders by others return every sample, whatever the samples are."""

import imagecodecs
import numpy as np
import pytest

from panchroma.shared.dng.lossless_jpeg import encode_lossless


@pytest.mark.parametrize("bits", [10, 12, 13, 14, 16])
@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (7, 1), (67, 101), (70, 2100), (40, 31, 3)])
def test_every_sample_comes_back(bits: int, shape: tuple[int, ...]) -> None:
    random = np.random.default_rng(0)
    top = (1 << bits) - 1
    even = random.integers(0, top, shape, endpoint=True)
    noisy = np.clip(random.normal(top / 3, 20, shape), 0, top)
    # unlike the rows that are counted
    surprise = np.where(np.arange(shape[0]).reshape(-1, *[1] * (len(shape) - 1)) % 32, even, 0)
    extremes = even % 2 * top, np.zeros(shape), np.full(shape, top), even % 2 * (top // 2 + 1)
    for samples in (even, noisy, surprise, *extremes):
        codes = samples.astype(np.uint16)
        jpeg = encode_lossless(codes, bits)
        np.testing.assert_array_equal(imagecodecs.jpeg8_decode(jpeg).reshape(shape), codes)
        if len(shape) == 2 and shape[1] > 1:
            np.testing.assert_array_equal(imagecodecs.ljpeg_decode(jpeg), codes)


def test_takes_hardly_more_than_the_best_code() -> None:
    """Close to what libjpeg needs, which counts every sample before it chooses a code."""
    codes = np.random.default_rng(0).normal(900, 40, (300, 400)).astype(np.uint16)
    best = imagecodecs.jpeg8_encode(codes, lossless=True, predictor=1, bitspersample=12)
    assert len(encode_lossless(codes, 12)) < 1.01 * len(best)
