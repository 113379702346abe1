"""What a journal's key depends on: everything that changes a picture, field by field, and nothing else."""

from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import pytest

import offline
from shared import Aberration, Camera, CfaPattern, SensorCalibration, Shading
from shared.calibration import NoiseModel
from tests.walking import one_field_changed
from tools.pictures.kind import PictureKind
from tools.rendering.burst import BurstOrder
from tools.rendering.order import Order
from tools.rendering.white_balance import WhiteBalance

EVEN = Shading((((1.0,) * 4,) * 4,) * 4, (13, 17), 35, 0.01)
CALIBRATION = SensorCalibration.of_bits(
    12,
    gamma=(0.9, 1.1, 0.8),
    noise=NoiseModel.gaussian(0.01, 4),
    camera_to_xyz=((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    neutral=(0.5, 1, 0.6),
    neutral_estimated=True,
    defects=((1, 2),),
    sensor="bench",
    shading=EVEN,
    aberration=Aberration(((0.001, 0), (0, 0), (0, 0.001)), (13, 17), 35),
)
WHOLE: dict[str, Any] = {
    "folder": Path("out"),
    "kind": PictureKind("jpg", 8, "srgb", 90),
    "preset": "best",
    "exposure": 0.5,
    "camera": Camera(CALIBRATION, CfaPattern.bayer(), {"shading": {"frames": 4}}),
    "run": "1",
    "white": WhiteBalance("", (1.0, 2.0, 1.0)),
    "defects": ((3, 4),),
}
ORDERS = [Order(**WHOLE), BurstOrder(**WHOLE, reference=1, shifts=((0.0, 0.0), (1.0, 0.0)))]
LIMITS = {"folder", "run", "resume", "overwrite", "dry_run"}  # in which nothing of a picture shows
NO_MATTER = {Order: LIMITS | {"max_pixels"}, BurstOrder: LIMITS}


def key(order: Order) -> str:
    return order.key(Path(order.folder) / "a.jpg", "")


@pytest.mark.parametrize("order", ORDERS)
def test_every_field_that_changes_a_picture_changes_its_key(order: Order, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(offline.PRESETS, "changed", offline.PAPER)  # whose name it is
    changed = dict(one_field_changed(order))
    assert {"camera.calibration.shading.focal_length", "camera.measured", "kind.quality", "white.kind"} <= changed.keys()
    whole = key(order)
    same = {name for name, other in changed.items() if _key_in(order.folder, other) == whole}
    assert same == NO_MATTER[type(order)]
    assert NO_MATTER[type(order)] == order.no_matter
    keys = [_key_in(order.folder, other) for other in changed.values()]
    assert len(set(keys) - {whole}) == len(changed) - len(same)  # no two of them are the same either


def _key_in(folder: Path, order: Order) -> str:
    """The key of an order, wherever its folder is."""
    object.__setattr__(order, "folder", folder)
    return key(order)


def test_every_setting_of_the_render_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = {key(Order(**WHOLE))}
    settings = dict(one_field_changed(offline.BEST))
    assert {each.name for each in fields(offline.BEST)} == {name.partition(".")[0] for name in settings}
    for other in settings.values():
        monkeypatch.setitem(offline.PRESETS, "best", other)
        keys.add(key(Order(**WHOLE)))
    monkeypatch.setattr("offline.version.ALGORITHM", -1)
    keys.add(key(Order(**WHOLE)))
    assert len(keys) == len(settings) + 2


def test_the_walk_leaves_no_part_unchanged() -> None:
    """The example has everything that an order can have: what is None or empty in it would be changed as a whole only."""

    def parts(whole: Any) -> list[Any]:
        values = [getattr(whole, each.name) for each in fields(whole)]
        return [whole, *(part for value in values if is_dataclass(value) for part in parts(value))]

    for part in parts(ORDERS[1]):
        without = {each.name for each in fields(part) if getattr(part, each.name) is None}
        assert without <= {"lights"}  # of which the matrix that stands here follows
