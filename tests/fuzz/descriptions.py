"""Streams whose description is wrong: each is refused, or passes with a remark on what it leaves open, and none passes silently.

python -m tests.fuzz.descriptions --count 2000 --seed 1
"""

import argparse
import sys
from collections import Counter
from random import Random

import numpy as np

from device.capture import Sensor
from device.frame_check import checked
from device.frames import FORMATS, FrameLayout, RawFrame
from shared import CfaPattern, SensorCalibration
from shared.errors import InputError
from shared.sensor import simulate_additive
from tests.device.packer import pack
from tools.scenes.drawn.builtin import builtin_scene

RIGHT, REFUSED, REMARK, SILENT = "right", "refused", "remark", "SILENT"
WRONG = ("stride", "width", "format", "period", "origin", "diagonal", "bits", "height")
_BITS = {"raw10": 10, "raw12": 12, "u16": 12}
_ORDERS = {"RGGB": ("GRBG", "GBRG"), "GRBG": ("RGGB", "BGGR")}


def case(seed: int, number: int) -> tuple[str, str]:
    """(What is wrong, the outcome) of a stream and its description; every ninth is described rightly."""
    random = Random(f"{seed} {number}")
    wrong = (*WRONG, RIGHT)[number % (len(WRONG) + 1)]
    name, period, order = random.choice(list(FORMATS)), random.choice((3, 4, 5, 6, 8)), random.choice(list(_ORDERS))
    width, height = random.randrange(160, 300, 2), random.randrange(128, 200)
    pattern = CfaPattern.bayer(period, order, (random.randrange(period), random.randrange(period)))
    bits = _BITS[name]
    scene = np.minimum(builtin_scene(width, height).rgb * random.choice((0.3, 1.0, 3.0)), 1.0).astype(np.float32)
    calibration = SensorCalibration.of_bits(bits, headroom=False)
    codes = simulate_additive(scene, pattern, calibration, random.choice((0.0, 0.01)), np.random.default_rng(number)).codes
    stride = FrameLayout(width, height, name).stride + random.choice((0, 2, 28, 64))
    data = pack(codes, name, stride) * 4
    described = {"width": width, "height": height, "format": name, "stride": stride}
    match wrong:
        case "stride":
            described["stride"] = stride + 2 * random.randrange(1, 60)
        case "width":  # and with it the stride, as without --stride
            described |= {"width": width + 2 * random.randrange(1, 30), "stride": 0}
            described["stride"] = FrameLayout(**described).stride + (2 if FrameLayout(**described).stride == stride else 0)  # type: ignore[arg-type]
        case "height":
            described["height"] = height + random.choice((-1, 1)) * random.choice([n for n in range(1, 20) if n % period])
        case "format":
            described |= {"format": random.choice([other for other in FORMATS if other != name]), "stride": 0}
        case "period":
            pattern = CfaPattern.bayer(random.choice([other for other in range(3, 13) if other != period]), order)
        case "origin":
            moved = (pattern.origin[0] + random.randrange(1, period)) % period
            pattern = CfaPattern.bayer(period, order, (moved, pattern.origin[1]))
        case "diagonal":
            pattern = CfaPattern.bayer(period, random.choice(_ORDERS[order]), pattern.origin)
        case "bits":
            data = codes.astype("<u2").tobytes() * 4
            described |= {"format": "u16", "stride": 0}
            bits = random.choice([other for other in (10, 12, 14, 16) if other != bits])
    layout = FrameLayout(**described)  # type: ignore[arg-type]
    return wrong, _outcome(data, Sensor(layout, pattern, _calibration(layout, bits)))


def _calibration(layout: FrameLayout, bits: int) -> SensorCalibration:
    return SensorCalibration.of_bits(bits if layout.format == "u16" else layout.bits, headroom=False)


def _outcome(data: bytes, sensor: Sensor) -> str:
    size = sensor.layout.frame_bytes
    frames = (RawFrame.now(data[first : first + size]) for first in range(0, len(data) - size + 1, size))
    remarks: list[str] = []
    try:
        list(checked(frames, sensor, remarks.append))
    except InputError:
        return REFUSED
    return REMARK if remarks else SILENT


def is_fault(wrong: str, outcome: str) -> bool:
    """Whether a wrong description passed silently, or a right one was refused."""
    return outcome == (REFUSED if wrong == RIGHT else SILENT)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, metavar="N")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    counts: Counter[tuple[str, str]] = Counter()
    faults = 0
    for number in range(arguments.count):
        found = case(arguments.seed, number)
        counts[found] += 1
        if is_fault(*found):
            faults += 1
            print(f"seed {arguments.seed} number {number}: {': '.join(found)}", file=sys.stderr)
    for (wrong, outcome), count in sorted(counts.items()):
        print(f"{wrong:10}{outcome:10}{count:6}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
