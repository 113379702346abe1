"""What cannot be is refused, and the message says what, and what was expected."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import (
    Camera,
    CaptureMetadata,
    CfaPattern,
    InputError,
    Mosaic,
    SensorCalibration,
    Shading,
    read_camera,
)
from panchroma.shared.calibration import SCHEMA
from panchroma.shared.dng import encode_dng
from panchroma.shared.figures import parsed_json
from tests.shared.dng.examples import calibration

PLAIN = SensorCalibration().to_json()
TILE = {"tile": ["RGW", "GBW", "WWW"]}
EVEN: Any = {"gain": [[[1.0] * 4] * 4] * 4, "size": (61, 90)}
WARM, COLD = (
    {"illuminant": name, "camera_to_xyz": np.eye(3).tolist(), "neutral": [1.0] * 3}
    for name in ("A", "D65")
)
HUGE = 10**400
SHAPE, CODES = (13, 9), np.full((24, 24), 500, np.uint16)
PAPER = CfaPattern.bayer(6)
CAMERA = Camera(calibration(), PAPER)
PREVIEW: Any = np.zeros((4, 4, 3), np.uint8)
SMALLEST = "whose largest figure is not 1e-06"
LIGHT_FIELDS = "lights is .*, expected an object with illuminant, camera"
OF_A_PATTERN = "is not an object with tile, origin and channels"


def matrix(*first_row: float) -> Any:
    return first_row, (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def shading(**changed: Any) -> dict[str, Any]:
    return {"shading": {**EVEN, **changed}}


def mosaic(samples: Any, pattern: CfaPattern = PAPER, **fields: Any) -> Mosaic:
    return Mosaic(samples, pattern, SensorCalibration.of_bits(12, **fields))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": SCHEMA + 1}, "schema"),
        ({"gama": [1, 1, 1]}, "unknown field 'gama'"),
        ({"channels": 3}, "channels is 3, expected str"),
        ({"sensor": None}, "sensor is None, expected str"),
        ({"neutral_estimated": 1}, "neutral_estimated is 1, expected bool"),
        ({"neutral_estimated": True}, "there is no neutral"),
        ({"channels": "R"}, "channels is 'R', expected two or more"),
        ({"channels": "RGR"}, "channels is 'RGR', expected two or more"),
        ({"channels": "rgb"}, "channels is 'rgb', expected two or more"),
        ({"channels": "RGW"}, "W stands for panchromatic"),
        ({"gamma": (1.0, 1.0)}, "gamma has 2 figures, expected 3"),
        ({"gamma": (1.0, 1e308, 1.0)}, "gamma holds .*, expected 0.001 to 1000"),
        ({"gamma": (1.0, 1e-320, 1.0)}, "gamma holds .*, expected 0.001 to 1000"),
        ({"black_level": (64.0, 64.0, 64.0)}, "black_level has 3 figures, expected 4"),
        ({"black_level": (64.0, 64.0, 64.0, 65000.0)}, "expected 0 <= black"),
        ({"black_level": (4094.9,) * 4, "white_level": 4095}, "at least 16 codes below white"),
        ({"white_level": 65536}, "white, which is 65535 at most"),
        ({"white_level": 4000.0}, "white_level is 4000.0, expected a whole number"),
        ({"noise": {"shot": [0.0] * 3, "read": [0.1] * 3}}, "noise has 3 planes, expected 4"),
        ({"noise": {"shot": [1e308] * 4, "read": [0.1] * 4}}, "shot .*, expected 0, or 1e-12"),
        ({"noise": {"shot": (-0.1,), "read": (0.1,)}}, "noise.shot has a negative"),
        ({"noise": {"shot": (0.1,), "read": (0.1, 0.1)}}, "1 planes, noise.read 2"),
        ({"noise": {"shot": [0.0] * 4}}, "noise is .*, expected an object with shot, read"),
        ({"neutral": (1.0, 1e-320, 1.0)}, "neutral holds .*, expected 1e-06 to"),
        ({"camera_to_xyz": matrix(1e300, 0.0, 0.0)}, SMALLEST),
        ({"camera_to_xyz": matrix(5e-324, 0.0, 0.0)}, SMALLEST),
        ({"camera_to_xyz": ((1.0, 0.0, 0.0), (0.0, 1.0, 1.0), (0.0, 1.0, 1.00001))}, "full rank"),
        ({"camera_to_xyz": matrix(1.0, 0.0, 0.0)[:2]}, "expected 3 rows of 3 figures"),
        ({"defects": list(np.ndindex(1025, 1025))}, "defects holds 1050625 pixels"),
        ({"defects": [[1, 2, 3]]}, "defects is not"),
        ({"defects": [[1.5, 2]]}, "defects is not"),
        ({"defects": [[-1, 2]]}, "defects is not"),
        ({"defects": [[0, 2**40]]}, "defects is not"),
        ({"defects": 7}, "defects is not"),
        ({"pattern": 7}, f"pattern: 7 {OF_A_PATTERN}"),
        ({"pattern": {**TILE, "origin": [0]}}, f"pattern: .* {OF_A_PATTERN}"),
        ({"pattern": {**TILE, "origin": [0, 0.5]}}, "origin is 0.5, expected a whole number"),
        ({"pattern": {**TILE, "size": 1}}, f"pattern: .* {OF_A_PATTERN}"),
        ({"pattern": {"tile": ["XYW", "YZW", "WWW"]}}, "RGB.*XYZ"),
        ({"size": [10, 24], "defects": [[9, 24]]}, "defect at row 9, column 24 lies outside"),
        ({"size": [0, 24]}, "size is .*, expected .rows, columns."),
        ({"measured": []}, "measured"),
        ({"measured": {"taste": {}}}, "unknown entry 'taste'"),
        ({"measured": {"gamma": 1}}, "measured.gamma"),
        (shading(gain=[[1.0] * 4] * 4), "gain is 1.0, expected a list of numbers"),
        (shading(gain=[[[1.0] * 3] * 4] * 4), "4 to 32 rows and columns"),
        (shading(gain=[[[1.0, 2.0], [1.0]]] * 4), "gain is not"),
        (shading(gain=[[[2e4] * 4] * 4] * 4), "control points of -10000 to 10000"),
        (shading(gain=[[[-1.0] * 4] * 4] * 4), "the gains are -1 to -1"),
        (shading(gain=[[[1.1] * 4] * 4] * 4), "in the middle of the frame"),
        (shading(gain=[[[1.0] * 4] * 4] * 3), r"shading has 3 planes, expected 4 \(RGBW\)"),
        (shading(residual=-1.0), "residual is -1"),
        (shading(size=5), "size is .*, expected .rows, columns."),
        (shading(more=1), "shading is .*, expected an object with gain, size, focal"),
        ({"lights": [WARM]}, "two lights"),
        ({"lights": [WARM, WARM]}, "A and A are alike"),
        ({"lights": [WARM, {**WARM, "illuminant": "3000"}]}, "A and 3000 are alike"),
        ({"lights": [WARM, {**COLD, "illuminant": "F11"}]}, "the light is 'F11'"),
        ({"lights": [WARM, {**COLD, "neutral": [1, 1]}]}, "expected 3 rows of 2"),
        ({"lights": [WARM, {**COLD, "neutral": [1, 0, 1]}]}, "lights.neutral is"),
        ({"lights": [WARM, {**COLD, "gamma": [0, 1, 1]}]}, "lights.gamma is .*, expected 0.001"),
        ({"lights": [WARM, {**COLD, "gamma": [1, 1]}]}, "other channels than RGB"),
        ({"lights": [WARM, {**COLD, "gamma": [1, 1, 1]}]}, "has a gamma, the other has none"),
        ({"lights": 7}, LIGHT_FIELDS),
        ({"lights": [WARM, {"illuminant": "D65"}]}, LIGHT_FIELDS),
        ({"lights": [WARM, COLD], "camera_to_xyz": np.eye(3)}, "leave one of them out"),
    ],
)
def test_a_wrong_camera_file_is_refused_by_field(change: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        Camera.from_json({**PLAIN, **change})


@pytest.mark.parametrize("document", [None, [], "text", 5, {}])
def test_what_is_not_a_calibration_is_refused(document: Any) -> None:
    with pytest.raises(InputError, match="calibration"):
        SensorCalibration.from_json(document)


@pytest.mark.parametrize(
    ("refused", "words"),
    [
        (lambda: SensorCalibration.of_bits(7), "7 bits: expected 8 to 16"),
        (lambda: SensorCalibration(gamma=(HUGE, 1, 1)), "gamma is .*, expected a list of numbers"),
        (lambda: SensorCalibration(defects=((HUGE, 1),)), "defects is not"),
        (lambda: Shading(EVEN["gain"], (800, HUGE)), "size is .*, expected .rows, columns."),
        (lambda: CfaPattern(("RG", "BW")), "2 rows"),
        (lambda: CfaPattern(("RGWW", "GBWW", "WWWW", "WWW")), "has 3 letters"),
        (lambda: CfaPattern(("RGWW", "GBWW", "WWWW", "WW1W")), "letters A to Z"),
        (lambda: CfaPattern(("RÜWW", "GBWW", "WWWW", "WWWW")), "letters A to Z"),
        (lambda: CfaPattern(("NNW", "NNW", "WWW")), "two or more"),
        (lambda: CfaPattern(("RGBRGB", *["GGGGGG"] * 4, "WWWWWW")), "row 3, column 1 of the tile"),
        (lambda: CfaPattern(("RGWRGW", "GBWGBW", "W" * 6) * 2), "smallest .*: RGW/GBW/WWW"),
        (lambda: CfaPattern(("RRRR", "GGGG", "BBBB", "RGBB")), "no panchromatic pixel"),
        (lambda: CfaPattern(("WWW", "WWW", "WWW")), "no colour filter"),
        (lambda: CfaPattern(("RGW", "GBW", "WWW"), channels="RGBB"), "do not name"),
        (lambda: CfaPattern.bayer(6, "RGBG"), "RGGB"),
        (lambda: CfaPattern.bayer(6, origin=(1.5, 0)), "pattern: the origin is 1.5, expected a wh"),  # type: ignore[arg-type]
        (lambda: CfaPattern.bayer(2), "period"),
        (lambda: CfaPattern.bayer(17), "period"),
        (lambda: CfaPattern.of_letters("RGW/GB/WWW"), "row by row"),
        (lambda: CfaPattern.of_letters(""), "row by row"),
        (lambda: CfaPattern.of_letters("/"), "row by row"),
        (lambda: CfaPattern.of_letters("RGW/GBW/"), "row by row"),
        (lambda: CfaPattern.of_letters("W" * 17), "1 x 17 letters repeats in squares of 17"),
        (lambda: CaptureMetadata(orientation=9), "orientation"),
        (lambda: CaptureMetadata(iso=0), "iso"),
        (lambda: CaptureMetadata(f_number=float("nan")), "f_number"),
        (lambda: CaptureMetadata(zone="CET"), "zone"),
        (lambda: CaptureMetadata(place=(91.0, 0.0)), "place"),
        (lambda: CaptureMetadata(altitude=1e10), "altitude"),
        (lambda: CAMERA.calibrated(mosaic(CODES, sensor="other")), "'other'.*'Prüfling 7'"),
        (lambda: CAMERA.calibrated(mosaic(CODES, CfaPattern.bayer(8))), "period 8.*period 6"),
        (lambda: CAMERA.calibrated(mosaic(CODES, CfaPattern.bayer(6, "BGGR"))), "BGW.*RGW"),
        (lambda: CAMERA.calibrated(mosaic(CODES, white_level=60000)), "16 bits.*12"),
        (lambda: CAMERA.calibrated(mosaic(CODES, white_level=1000)), "10 bits.*12"),
        (lambda: encode_dng(mosaic(np.zeros((6, 65501))), PREVIEW), "at most 65500"),
        (lambda: encode_dng(mosaic(np.zeros(SHAPE)), PREVIEW / 2), "expected a uint8 picture"),
        (lambda: encode_dng(mosaic(np.zeros(SHAPE)), PREVIEW[:0]), "expected a uint8 picture"),
        (lambda: mosaic(np.zeros(9, np.uint16)), "shape"),
        (lambda: mosaic(np.zeros((1, 9), np.uint16)), "no whole colour block"),
        (lambda: mosaic(np.zeros(SHAPE, np.uint8)), "uint8, expected uint16 codes"),
        (lambda: mosaic(np.full(SHAPE, 4096, np.uint16)), "4096, more than .* 12 bits"),
        (lambda: mosaic(np.full(SHAPE, np.nan)), "117 of 117 samples are not finite"),
        (lambda: mosaic(np.full(SHAPE, -np.inf, np.float32)), "not finite"),
        (lambda: mosaic([[1, 2, 3]] * 3), "int64"),
    ],
)
def test_what_cannot_be_is_refused(refused: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        refused()
    assert len(str(caught.value)) < 500


# --- numbers --------------------------------------------------------------------------------------

MEASURED = calibration(defects=((1, 2),), shading=Shading(**EVEN)).to_json() | {
    "measured": {
        "gamma": {"half_width_95": [0.1, 0.2, 0.3]},
        "black_level": {"frames": 2, "standard_error": [1.0] * 4},
    }
}
TEXT = json.dumps(MEASURED)
NUMBERS = [number.span() for number in re.finditer(r"-?\b\d[\d.e+-]*(?=[],}])", TEXT)]


@pytest.mark.parametrize("figure", [HUGE, -HUGE, float("nan"), float("inf"), "1", True])
def test_whatever_is_no_number_in_a_camera_file_is_refused(figure: Any, tmp_path: Path) -> None:
    file, notes = tmp_path / "camera.json", TEXT.index('"measured"')
    file.write_text(TEXT)
    read_camera(file)
    for start, end in NUMBERS:
        if start > notes and isinstance(figure, str | bool):
            continue  # these are for people
        file.write_text(TEXT[:start] + json.dumps(figure) + TEXT[end:])
        with pytest.raises(InputError, match=r"camera\.json: "):
            read_camera(file)


def test_documents_are_refused_with_the_reason() -> None:
    assert parsed_json(b'{"a": [1, -2.5e3]}') == {"a": [1, -2500.0]}
    wrong: dict[str | bytes, str] = {
        **dict.fromkeys(("[", b"\xff", "[" * 100_000), "is not JSON"),
        "-" + "9" * 5000: "^holds a number of 5000 digits",
        "1e999": "^holds '1e999'",
        "[NaN]": "holds 'NaN'",
        '{"a": 1, "b": 2, "a": 3}': "holds 'a' twice",
    }
    for text, words in wrong.items():
        with pytest.raises(InputError, match=words):
            parsed_json(text)
