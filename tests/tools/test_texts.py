import json
from pathlib import Path

import pytest

from panchroma.shared import InputError, read_camera
from panchroma.tools.calibration.reference import read_reference
from panchroma.tools.simulation.drawn.charts import color_checker_xyz
from panchroma.tools.simulation.pattern_text import read_pattern
from tests.tools.calibration.known_camera import cgats


def test_every_file_that_a_user_writes_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    """Windows' editors and PowerShell put it there."""
    camera = {"schema": 1, "gamma": [0.9, 1.1, 0.8], "white_level": 60000}
    for name, text, read in (
        ("camera.json", json.dumps(camera), read_camera),
        ("pattern.txt", "WBWG/BWGW/WGWR/GWRW", lambda path: read_pattern(str(path))),
        ("chart.ti3", cgats(color_checker_xyz()), lambda path: read_reference(path).tolist()),
    ):
        plain, marked, wide = (tmp_path / f"{kind}-{name}" for kind in ("plain", "marked", "wide"))
        plain.write_text(text, "utf-8")
        marked.write_text(text, "utf-8-sig")
        wide.write_text(text, "utf-16")
        assert read(marked) == read(plain), name
        with pytest.raises(InputError, match=f"wide-{name}: is not a text in UTF-8 .*as UTF-8"):
            read(wide)
