"""The files that the fuzzer damages: small, of every kind that Panchroma reads, made by its
writers; and their readers.
"""

import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from panchroma.device import Preview
from panchroma.device.capture import Sensor
from panchroma.device.capture.frames import FrameLayout, RawFrame, read_frames
from panchroma.offline import PAPER, render
from panchroma.shared import Camera, CfaPattern, FloatArray, Mosaic, SensorCalibration, read_dng
from panchroma.shared.dng import encode_dng, read_preview
from panchroma.tools.calibration.conclude import conclude
from panchroma.tools.calibration.dark_frames import measure_dark
from panchroma.tools.calibration.files import read_known
from panchroma.tools.calibration.measure import Measurements, measure_chart
from panchroma.tools.calibration.reference import read_reference
from panchroma.tools.io.development import Development
from panchroma.tools.io.kind import PictureKind
from panchroma.tools.simulation.drawn.charts import color_checker_xyz
from panchroma.tools.simulation.load import load_scene
from tests.device.packer import pack, random_codes
from tests.fuzz.forged import npy
from tests.shared.dng.examples import METADATA, calibration, mosaic, preview
from tests.tools.calibration.known_camera import cgats, chart, frame, true_place
from tests.tools.io.examples import encode_picture

Read = Callable[[Path], Any]
"""Reads a file. Two results are equal exactly when the same was read."""


@dataclass(frozen=True)
class Sample:
    """An undamaged file.

    kind: name of the format, as in the table of outcomes.
    suffix: of the file's name.
    data: its bytes.
    read: its reader.
    sealed: the format has a digest: a damaged file must never read as something else.
    """

    kind: str
    suffix: str
    data: bytes
    read: Read
    sealed: bool = False


@cache
def corpus() -> tuple[Sample, ...]:
    """Every sample, always the same ones."""
    return (*_shots(), *_pictures(), *_linear(), *_raws(), *_documents(), *_streams())


def _shots() -> list[Sample]:
    patterns = [
        CfaPattern.bayer(6),
        CfaPattern.bayer(9),
        CfaPattern.with_block(("RGB", "XWY"), 9, (2, 3)),
        CfaPattern.bayer(4),
        CfaPattern.of_letters("WBWG/BWGW/WGWR/GWRW", (1, 2)),
    ]
    files = [encode_dng(mosaic(pattern), preview(24, 32)) for pattern in patterns]
    files.append(encode_dng(mosaic(CfaPattern.bayer(9), (64, 48)), preview(24, 32)))
    return [Sample("DNG", ".dng", data, _read_shot, sealed=True) for data in files]


def _read_shot(path: Path) -> bytes:
    shot = read_dng(path)
    read_preview(path)
    return repr((shot.pattern, shot.calibration, shot.shape)).encode() + shot.codes.tobytes()


def _pictures() -> list[Sample]:
    rgb = (
        np.random.default_rng(3).random((23, 31, 3)).astype(np.float32)
        * np.linspace(0, 1, 31, dtype=np.float32)[:, None]
    )
    samples = [
        Sample(kind.format.upper(), kind.suffix, _rendered(rgb, kind), _read_scene)
        for kind in (PictureKind(name, bits, space) for name, bits, space in _KINDS)
    ]
    codes = (rgb * 65535).astype(np.uint16)
    for tile, compression in product((None, (16, 16)), ("zlib", "lzw", None)):
        written = _tiff(codes, photometric="rgb", tile=tile, compression=compression)
        samples.append(Sample("TIF", ".tif", written, _read_scene))
    bands = codes[..., [0, 1, 2, 0, 1]]
    read_bands = partial(_read_scene, channels="VRGNU")
    stack = _tiff(np.moveaxis(bands, -1, 0).copy(), photometric="minisblack", compression="zlib")
    array = npy(bands.shape, "<u2") + bands.tobytes()
    return [
        *samples,
        Sample("TIF", ".tif", stack, read_bands),
        Sample("NPY", ".npy", array, read_bands),
    ]


def _rendered(rgb: FloatArray, kind: PictureKind) -> bytes:
    """A picture as `render` writes it."""
    known = SensorCalibration(camera_to_xyz=calibration().camera_to_xyz, neutral=(0.5, 1.0, 0.7))
    return encode_picture(rgb, Development(kind, (23, 31), known, METADATA))


def _tiff(samples: NDArray[Any], **options: Any) -> bytes:
    """A TIFF as tifffile writes it."""
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, samples, **options)
    return buffer.getvalue()


_KINDS = (
    ("tif", 16, "srgb"),
    ("tif", 32, "camera"),
    ("png", 8, "srgb"),
    ("png", 16, "display-p3"),
    ("jpg", 8, "srgb"),
    ("exr", 16, "camera"),
    ("exr", 32, "camera"),
    ("npy", 32, "camera"),
)


_VERSION: Any = (50706, 1, 4, bytes([1, 4, 0, 0]), True)  # of DNG


def _read_scene(path: Path, channels: str = "RGB") -> bytes:
    scene = load_scene(str(path), channels=channels)
    return repr(scene.rgb.shape).encode() + scene.rgb.tobytes()


def _linear() -> list[Sample]:
    """Linear DNGs: a render of ours, and those that other programs write, in tiles or strips, of
    integers or floating point.
    """
    rgb = np.random.default_rng(4).random((23, 31, 3)).astype(np.float32)
    files = [_rendered(rgb, PictureKind("dng", 16, "camera"))]
    levels = (
        (50712, 3, 3, (0, 30000, 65535), True),
        (50714, 3, 1, 7, True),
        (50717, 3, 1, 60000, True),
        (50829, 3, 4, (1, 2, 20, 30), True),
    )
    for samples, tile, compression in (
        ((rgb * 65535).astype(np.uint16), (16, 16), None),
        ((rgb * 2).astype(np.uint16), None, "zlib"),
        (rgb, (16, 16), "zlib"),
    ):
        tags = [_VERSION, *(levels if samples.dtype == np.uint16 else ())]
        pieces: dict[str, Any] = {"tile": tile} if tile else {"rowsperstrip": 7}
        pieces |= {"compression": compression, "extratags": tags}
        files.append(_tiff(samples, photometric="linear_raw", planarconfig="contig", **pieces))
    return [Sample("linear DNG", ".dng", data, _read_scene) for data in files]


def _raws() -> list[Sample]:
    """A Bayer camera's DNG, which LibRaw decodes."""
    tags = [
        _VERSION,
        (50708, 2, 0, "Camera", True),
        (33421, 3, 2, (2, 2), True),
        (33422, 1, 4, bytes([0, 1, 1, 2]), True),
        (50721, 10, 9, (1, 1, 0, 1, 0, 1, 0, 1, 1, 1, 0, 1, 0, 1, 0, 1, 1, 1), True),
    ]
    written = _tiff(random_codes((40, 52), 12), photometric=32803, extratags=tags, subfiletype=0)
    return [Sample("camera RAW", ".dng", written, _read_scene)]


def _documents() -> list[Sample]:
    measured = {"gamma": {"shots": 3, "sigma": [0.1, 0.2]}}
    full = Camera(calibration(defects=((3, 4), (5, 6))), CfaPattern.bayer(6), measured)
    plain = SensorCalibration()
    colours = cgats(color_checker_xyz())
    return [
        *(
            Sample("camera.json", ".json", json.dumps(each.to_json()).encode(), _read_camera)
            for each in (full, plain, _measured())
        ),
        Sample("CGATS", ".ti3", colours.encode(), lambda path: read_reference(path).tobytes()),
    ]


def _measured() -> Camera:
    """A camera file that was measured: from a dark frame, and a chart."""
    dark, lit = frame(np.zeros((60, 60, 3))), frame(chart().rgb)
    shot = measure_chart("chart.dng", lit, Measurements(color_checker_xyz()), true_place().corners)
    found = Measurements(color_checker_xyz(), lit, dark=measure_dark([dark]), shots=[shot])
    return conclude(found).camera


def _read_camera(path: Path) -> bytes:
    """The file, and all that is computed from it, where no number may overflow: an update, a
    preview and a render.
    """
    camera = read_known(path)
    pattern = camera.pattern or CfaPattern.bayer(6)
    codes = np.linspace(0, (1 << camera.calibration.bits) - 1, 24 * 30).astype(np.uint16)
    with np.errstate(all="raise", under="ignore"):
        shot = Mosaic(codes.reshape(24, 30), pattern, camera.calibration)
        conclude(Measurements(color_checker_xyz(), shot, camera))
        assert np.isfinite(render(shot, PAPER).rgb).all()
        Preview.for_mosaic(shot).run(shot)
    return json.dumps(camera.to_json()).encode()


def _streams() -> list[Sample]:
    samples = []
    for name, bits, stride in (("raw10", 10, 40), ("raw12", 12, 64), ("u16", 12, 0)):
        layout = FrameLayout(24, 18, name, stride)
        sensor = Sensor(layout, CfaPattern.bayer(6), SensorCalibration.of_bits(bits))
        frames = (random_codes((18, 24), bits, seed) for seed in range(2))
        data = b"".join(pack(codes, name, layout.stride) for codes in frames)

        def read(path: Path, sensor: Sensor = sensor) -> bytes:
            with path.open("rb", buffering=0) as file:
                frames: list[RawFrame] = list(read_frames(file, sensor.layout))
            return b"".join(sensor.mosaic(frame).codes.tobytes() for frame in frames)

        samples.append(Sample("raw stream", ".raw", data, read))
    return samples
