"""Streams whose description is wrong: each is refused, or passes with a remark on what it leaves open, and none passes silently.

python -m tests.fuzz.descriptions --count 2000 --seed 1
"""

import sys
from dataclasses import dataclass, replace
from random import Random

import numpy as np

from device.capture import Sensor
from device.capture.frame_check import checked
from device.capture.frames import FORMATS, FrameLayout, RawFrame
from shared import CfaPattern, SensorCalibration
from shared.errors import InputError
from tests.device.packer import pack
from tests.fuzz.sweep import sweep
from tools.simulation.drawn.builtin import builtin_scene
from tools.simulation.sensor import simulate_additive

RIGHT, REFUSED, REMARK, SILENT = "right", "refused", "remark", "SILENT"
WRONG = ("stride", "width", "padding", "format", "period", "origin", "diagonal", "bits", "height", "packing", "everything")
_SENT = {name: min(packing.bits, 12 if packing.words else 14) for name, packing in FORMATS.items()}  # bits of a sample
_ORDERS = {"RGGB": ("GRBG", "GBRG"), "GRBG": ("RGGB", "BGGR"), "GBRG": ("RGGB", "BGGR"), "BGGR": ("GRBG", "GBRG")}


@dataclass(frozen=True)
class Described:
    """The options with which a user describes a stream; those of `panchroma capture`. stride: 0 = no padding."""

    width: int
    height: int
    format: str
    stride: int
    period: int
    order: str
    origin: tuple[int, int]
    bits: int

    @property
    def pattern(self) -> CfaPattern:
        return CfaPattern.bayer(self.period, self.order, self.origin)

    @property
    def sensor(self) -> Sensor:
        """Raises InputError as the command does."""
        layout = FrameLayout(self.width, self.height, self.format, self.stride)
        bits = self.bits if layout.has_words else layout.bits
        return Sensor(layout, self.pattern, SensorCalibration.of_bits(bits, headroom=False))


def case(seed: int, number: int) -> tuple[str, str]:
    """(What is wrong, the outcome) of a stream and its description; one in twelve is described rightly."""
    random = Random(f"{seed} {number}")
    wrong = (*WRONG, RIGHT)[number % (len(WRONG) + 1)]
    sent = random.choice(list(FORMATS))
    period, order, bits = random.choice((3, 4, 5, 6, 8)), random.choice(list(_ORDERS)), _SENT[sent]
    width, height = random.randrange(160, 300, 2), random.randrange(128, 200)
    pixels, length = FORMATS[sent].pixels, FORMATS[sent].length
    stride = -(-width // pixels) * length + (64 if wrong == "padding" else random.choice((0, 2, 28, 64)))
    other = [name for name in FORMATS if name != sent]
    origin = random.randrange(period), random.randrange(period)
    true = Described(width, height, sent, stride, period, order, origin, bits)
    scene = np.minimum(builtin_scene(width, height).rgb * random.choice((0.3, 1.0, 3.0)), 1.0).astype(np.float32)
    calibration = SensorCalibration.of_bits(bits, headroom=False)
    noise = random.choice((0.0, 0.01)), np.random.default_rng(number)
    codes = simulate_additive(scene, true.pattern, calibration, *noise).codes
    described, padding = true, random.choice((0, 0xA5))
    match wrong:
        case "stride":
            described = replace(true, stride=stride + 2 * random.randrange(1, 60))
        case "width":  # and with it the stride, as without --stride
            wide = replace(true, width=width + 2 * random.randrange(1, 30), stride=0)
            tight = wide.sensor.layout.stride
            described = replace(wide, stride=tight + 2 * (tight == stride))
        case "padding":
            described = replace(true, width=width + pixels * random.randrange(1, 64 // length + 1))
        case "height":
            described = replace(
                true, height=height + random.choice((-1, 1)) * random.choice([n for n in range(1, 20) if n % period])
            )
        case "format":
            described = replace(true, format=random.choice(other), stride=0)
        case "period":
            described = replace(true, period=random.choice([other for other in range(3, 13) if other != period]), origin=(0, 0))
        case "origin":
            described = replace(true, origin=((origin[0] + random.randrange(1, period)) % period, origin[1]))
        case "diagonal":
            described = replace(true, order=random.choice(_ORDERS[order]))
        case "bits":
            stride = 2 * width
            true = replace(true, format="u16", stride=stride)
            described = replace(true, bits=random.choice([other for other in (10, 12, 14, 16) if other != bits]))
        case "packing" | "everything":
            described = replace(true, format=random.choice(other), stride=random.choice((0, stride)), bits=12)
            if described.stride and FrameLayout(width, height, described.format).stride > stride:
                described = replace(described, stride=0)
            if wrong == "everything":
                place = random.randrange(12), random.randrange(12)
                described = replace(described, period=random.choice((4, 6, 8)), order=random.choice(list(_ORDERS)), origin=place)
    data = pack(codes, true.format, true.stride, padding) * 4
    return wrong, _outcome(data, described)


def _outcome(data: bytes, described: Described) -> str:
    """What becomes of a stream."""
    remarks: list[str] = []
    try:
        sensor = described.sensor
        size = sensor.layout.frame_bytes
        frames = (RawFrame.now(data[first : first + size]) for first in range(0, len(data) - size + 1, size))
        list(checked(frames, sensor, remarks.append))
    except InputError:
        return REFUSED
    return REMARK if remarks else SILENT


def is_fault(wrong: str, outcome: str) -> bool:
    """Whether a wrong description passed silently, or a right description was refused."""
    return outcome == (REFUSED if wrong == RIGHT else SILENT)


def tried(seed: int, number: int) -> tuple[str, str, str]:
    """(What is wrong, the outcome, what is wrong once more if that is a fault) of a case."""
    wrong, found = case(seed, number)
    return wrong, found, wrong if is_fault(wrong, found) else ""


if __name__ == "__main__":
    sys.exit(sweep(__doc__, tried, is_fault))
