"""The scenarios: each command on a few small files, so that it writes often."""

from io import BytesIO
from pathlib import Path

import numpy as np

from panchroma.shared import CfaPattern
from panchroma.shared.dng import encode_dng
from tests.device.packer import pack, random_codes
from tests.faults.scenario import Scenario, known, replacing
from tests.shared.dng.examples import mosaic, preview

_FRAMES = 6


def worlds(folder: Path) -> list[Scenario]:
    """simulate, render and capture; the first two also over older results. folder: for an undisturbed run of each."""
    return [*pictures(folder), capture()]


def pictures(folder: Path) -> list[Scenario]:
    """simulate and render, with and without older results."""
    pattern = CfaPattern.bayer(6)
    shots = {f"shot{each}.dng": encode_dng(mosaic(pattern, (60, 80 + each)), preview(24, 32)) for each in range(4)}
    scenes = {f"scene{number}.npy": scene(number) for number in range(4)}
    # Without noise, which would depend on the names of the shots.
    simulate = known("simulate", ["simulate", *scenes, "-o", "out", "--truth"], scenes, folder / "simulate")
    render = known("render", ["render", *shots, "-o", "out"], shots, folder / "render")
    return [simulate, replacing(simulate), render, replacing(render)]


def capture() -> Scenario:
    """capture of a recording. Results are named after the time, so that only their completeness can be checked."""
    frames = b"".join(pack(random_codes((24, 32), 10, seed), "raw10") for seed in range(_FRAMES))
    layout = ["--size", "32x24", "--pixel-format", "raw10"]
    return Scenario("capture", ("capture", "-", "-o", "out", *layout), {}, {}, {}, frames)


def scene(number: int) -> bytes:
    """A linear picture, as a file in NPY format."""
    file = BytesIO()
    np.save(file, np.random.default_rng(number).random((60, 80, 3)).astype(np.float32))
    return file.getvalue()
