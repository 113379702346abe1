"""Mosaics to save: every field filled in, so that one that gets lost shows."""

from datetime import datetime

import numpy as np

from panchroma.shared import CaptureMetadata, CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import ByteArray

METADATA = CaptureMetadata(
    make="Contax",
    model="G2 (II)",
    lens="Käthe 1:2,8/35 µm",
    artist="Jürgen Müller — 山田",
    copyright="© 2014 Käthe",
    description='quoted "text", a \\ and an & in it',
    taken=datetime(2014, 3, 9, 7, 5, 1, 20300),  # noqa: DTZ001  local time, as Exif has it
    exposure_time=1 / 250,
    f_number=2.8,
    iso=640,
    focal_length=34.56,
    orientation=6,
    zone="+05:30",
    place=(-33.85703889, 151.21111111),
    altitude=-2.5,
)


def preview(rows: int = 60, columns: int = 80) -> ByteArray:
    """A picture that differs in every direction and channel."""
    down, across = np.mgrid[:rows, :columns]
    return np.stack([down * 4, across * 3, 255 - down * 2 - across], axis=-1).astype(np.uint8)


def calibration(channels: str = "RGB", bits: int = 12, **fields: object) -> SensorCalibration:
    """A calibration whose planes differ in everything."""
    count, plain = len(channels), SensorCalibration.of_bits(bits)
    planes, rows = np.arange(count + 1), np.arange(3)[:, None]
    shot, read = (1e-3 * (planes + 1)).tolist(), (0.01 / (planes + 1)).tolist()
    to_xyz = ((rows - planes[:-1]) % count == 0) + 0.1
    given: dict[str, object] = {
        "gamma": tuple((0.7 + 0.21 * planes[:-1]).tolist()),
        "noise": NoiseModel(tuple(shot), tuple(read)),
        "black_level": tuple((plain.black_level[0] + planes).tolist()),
        "white_level": plain.white_level,
        "camera_to_xyz": tuple(map(tuple, to_xyz.tolist())),
        "neutral": tuple((0.5 + 0.1 * planes[:-1]).tolist()),
    }
    return SensorCalibration(channels, sensor="Prüfling 7", **{**given, **fields})  # type: ignore[arg-type]


def mosaic(
    pattern: CfaPattern | None = None,
    shape: tuple[int, int] = (37, 53),
    calibrated: SensorCalibration | None = None,
    metadata: CaptureMetadata = METADATA,
) -> Mosaic:
    """Random codes, the lowest and the highest among them."""
    pattern = CfaPattern.bayer(6) if pattern is None else pattern
    calibrated = calibration(pattern.channels) if calibrated is None else calibrated
    codes = np.random.default_rng(6).integers(0, 1 << calibrated.bits, shape).astype(np.uint16)
    codes[0, 1::2], codes[0, ::2] = 0, (1 << calibrated.bits) - 1
    return Mosaic(codes, pattern, calibrated, metadata)


def same(one: Mosaic, other: Mosaic) -> bool:
    """Whether two mosaics are equal in all that is measured: codes, pattern, calibration."""
    stated, expected = ((each.pattern, each.calibration) for each in (one, other))
    return stated == expected and np.array_equal(one.codes, other.codes)
