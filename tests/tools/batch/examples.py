"""Small shots, and a system without semaphores."""

import errno
import multiprocessing.synchronize
import os
from pathlib import Path

import numpy as np
import pytest

from panchroma.shared import CfaPattern, Mosaic, SensorCalibration, write_dng
from panchroma.shared.calibration import NoiseModel


def save_mosaic(path: Path, mosaic: Mosaic) -> Path:
    """A shot with a black preview, in place of what is there; folders are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_dng(path, mosaic, np.zeros((8, 8, 3), np.uint8), overwrite=True)
    return path


def without_semaphores(monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, as on a system without /dev/shm."""

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENXIO, os.strerror(errno.ENXIO))

    monkeypatch.setattr(multiprocessing.synchronize.SemLock, "__init__", refuse)


def save_shot(path: Path, seed: int = 0, shape: tuple[int, int] = (13, 17)) -> Path:
    """A shot of random samples; folders are made."""
    calibration = SensorCalibration.of_bits(12, noise=NoiseModel.gaussian(0.01, 4))
    samples = np.random.default_rng(seed).integers(256, calibration.white_level, shape, np.uint16)
    return save_mosaic(path, Mosaic(samples, CfaPattern.bayer(), calibration))
