"""Small shots, and what a run of `panchroma render` in a process of its own says of them."""

import subprocess
from pathlib import Path

import numpy as np

from shared import CfaPattern, Mosaic, SensorCalibration, write_dng
from shared.calibration import NoiseModel
from tests.data import ROOT
from tests.tools.command import PROGRAM


def save_shot(path: Path, seed: int = 0, shape: tuple[int, int] = (13, 17)) -> Path:
    """A shot of random samples; folders are made."""
    calibration = SensorCalibration.of_bits(12, noise=NoiseModel.gaussian(0.01, 4))
    samples = np.random.default_rng(seed).integers(256, calibration.white_level, shape, np.uint16)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_dng(path, Mosaic(samples, CfaPattern.bayer(), calibration), np.zeros((8, 8, 3), np.uint8))
    return path


def start(*arguments: str | Path) -> "subprocess.Popen[str]":
    """The command, begun in a process of its own."""
    line = [*PROGRAM, *map(str, arguments)]
    return subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def contents(folder: Path) -> dict[str, bytes]:
    """Path below the folder -> bytes, of every file, hidden ones too."""
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
