"""Numbers of documents and of callers: whatever is not a finite number is refused by name,
everywhere.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from panchroma.shared import InputError, NoiseModel, SensorCalibration, Shading, read_camera
from panchroma.shared.figures import parsed_json

HUGE = 10**400
SHADING = Shading([[[1.0] * 4] * 4] * 4, (800, 1200))  # type: ignore[arg-type]
CALIBRATION = SensorCalibration.of_bits(
    12,
    noise=NoiseModel.gaussian(0.01, 4),
    neutral=(0.5, 1.0, 0.7),
    camera_to_xyz=np.eye(3).tolist(),
    defects=((1, 2),),
    shading=SHADING,
)
DOCUMENT = {
    **CALIBRATION.to_json(),
    "measured": {
        "gamma": {"half_width_95": [0.1, 0.2, 0.3]},
        "black_level": {"frames": 2, "standard_error": [1.0] * 4},
    },
}
DOCUMENT.pop("camera")


TEXT = json.dumps(DOCUMENT)
NUMBERS = [number.span() for number in re.finditer(r"-?\b\d[\d.e+-]*", TEXT)]


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


@pytest.mark.parametrize("figure", [HUGE, "1", True, None, [1]])
@pytest.mark.parametrize(
    "of",
    [
        lambda figure: Shading([[[figure] * 4] * 4] * 4, (800, 1200)),  # type: ignore[arg-type]
        lambda figure: Shading(SHADING.gain, (800, figure)),
        lambda figure: SensorCalibration(gamma=(figure, 1, 1)),
        lambda figure: SensorCalibration(defects=((figure, 1),)),
    ],
)
def test_callers_get_an_error_by_name_too(of: Callable[[Any], Any], figure: Any) -> None:
    with pytest.raises(InputError) as caught:
        of(figure)
    assert len(str(caught.value)) < 500


def test_documents_are_refused_with_the_reason() -> None:
    assert parsed_json(b'{"a": [1, -2.5e3]}') == {"a": [1, -2500.0]}
    wrong: dict[str | bytes, str] = {
        **dict.fromkeys(("[", b"\xff", "[" * 100_000), "is not JSON"),
        "-" + "9" * 5000: "^holds a number of 5000 digits",
        "1e999": "^holds '1e999'",
        "[NaN]": "holds 'NaN'",
    }
    for text, words in wrong.items():
        with pytest.raises(InputError, match=words):
            parsed_json(text)
