"""The commands that are interrupted: each on a few small files, so that it writes often."""

from pathlib import Path

import numpy as np

from shared import CfaPattern, Mosaic
from shared.dng import encode_dng
from tests.device.packer import pack, random_codes
from tests.faults.scenario import Scenario, known, replacing
from tests.shared.dng.examples import METADATA, calibration, mosaic, preview
from tools.pictures.writer import PictureKind, encode_picture

_FRAMES = 6


def worlds(folder: Path) -> list[Scenario]:
    """simulate, render and capture; the first two also over older results. `folder`: for a first, undisturbed run of each."""
    return [*pictures(folder), capture()]


def pictures(folder: Path) -> list[Scenario]:
    """simulate and render."""
    shots = {f"shot{number}.dng": encode_dng(_shot(number), preview(24, 32)) for number in range(4)}
    scenes = {f"scene{number}.npy": scene(number) for number in range(4)}
    simulate = known("simulate", ["simulate", *scenes, "-o", "out", "--sigma", "0.01", "--truth"], scenes, folder / "simulate")
    render = known("render", ["render", *shots, "-o", "out"], shots, folder / "render")
    return [simulate, replacing(simulate), render, replacing(render)]


def capture() -> Scenario:
    """Frames of a recording; their names are times, so that nothing but wholeness is known of them."""
    frames = b"".join(pack(random_codes((24, 32), 10, seed), "raw10") for seed in range(_FRAMES))
    layout = ["--width", "32", "--height", "24", "--format", "raw10"]
    return Scenario("capture", ("capture", "-", "-o", "out", *layout), {}, {}, {}, frames)


def _shot(number: int) -> Mosaic:
    return mosaic(CfaPattern.bayer(6), (60, 80 + number))


def scene(number: int) -> bytes:
    """A linear picture."""
    rgb = np.random.default_rng(number).random((60, 80, 3)).astype(np.float32)
    return encode_picture(rgb, PictureKind("npy", 32, "camera"), calibration=calibration(), metadata=METADATA)
