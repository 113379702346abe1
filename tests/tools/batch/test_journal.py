"""The journal: what was written is read, by others too, a cut-off line costs nothing but itself;
and what its keys depend on.
"""

import hashlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from panchroma import offline
from panchroma.shared import Camera, CfaPattern, SensorCalibration, Shading
from panchroma.shared.calibration import NoiseModel
from panchroma.shared.errors import OutputError
from panchroma.tools.batch.burst_files import BurstOrder
from panchroma.tools.batch.chosen_white import WhiteBalance
from panchroma.tools.batch.journal import NAME, Entry, Journal, digest, output_lock
from panchroma.tools.batch.order import Order
from panchroma.tools.io.kind import PictureKind
from tests.walking import one_field_changed


def entry(output: str = "a.tif", digest: str = "d") -> Entry:
    return Entry(output, digest, "k", "r", "a.dng", "i")


def test_what_is_appended_is_found_by_all_who_hold_it(tmp_path: Path) -> None:
    one, other = Journal(tmp_path), Journal(tmp_path)
    assert one.of("a.tif") == []
    assert not (tmp_path / NAME).exists()
    other.append(entry())
    assert one.of("a.tif") == [entry()]
    other.append(entry(digest="e"))
    one.append(entry("sub/\udce9 x.tif"))
    assert one.of("a.tif") == [entry(), entry(digest="e")]
    assert other.of("sub/\udce9 x.tif") == [entry("sub/\udce9 x.tif")]


@pytest.mark.parametrize("kept", [1, 40, -1])
def test_a_torn_line_is_no_entry_and_spoils_none(tmp_path: Path, kept: int) -> None:
    path = tmp_path / NAME
    reader = Journal(tmp_path)
    for name in ("a.tif", "b.tif"):
        Journal(tmp_path).append(entry(name))
    first, second = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(first + second[:kept])
    assert reader.of("b.tif") == []
    Journal(tmp_path).append(entry("c.tif"))
    there = [bool(reader.of(name)) for name in ("a.tif", "b.tif", "c.tif")]
    assert there == [True, kept == -1, True]


@pytest.mark.parametrize(
    "line",
    [b"[1]", b"{}", b'{"format": 2}', b"\xff\0", b"[" * 9999, b'{"format": 1, "output": 3}', b""],
)
def test_lines_of_others_are_not_believed(tmp_path: Path, line: bytes) -> None:
    (tmp_path / NAME).write_bytes(line + b"\n")
    journal = Journal(tmp_path)
    journal.append(entry())
    assert journal.of("a.tif") == [entry()]


@pytest.mark.parametrize("link", [Path.symlink_to, Path.hardlink_to])
def test_a_link_in_the_place_of_the_journal_changes_no_original(
    tmp_path: Path, link: Callable[[Path, Path], None]
) -> None:
    original = tmp_path / "shot.dng"
    original.write_bytes(b"a photograph")
    link(tmp_path / NAME, original)
    with pytest.raises(OutputError, match=r"remove it|replace it by a copy"):
        Journal(tmp_path).append(entry())
    assert original.read_bytes() == b"a photograph"


def test_a_link_in_the_place_of_a_lock_makes_nothing(tmp_path: Path) -> None:
    with output_lock(tmp_path / "a.tif"):
        (lock,) = tmp_path.iterdir()
    lock.symlink_to("elsewhere")
    with pytest.raises(OSError, match="remove it"), output_lock(tmp_path / "a.tif"):
        pass
    assert not (tmp_path / "elsewhere").exists()


def test_a_digest_is_that_of_every_byte(tmp_path: Path) -> None:
    (tmp_path / "one").write_bytes(b"12")
    assert digest(tmp_path / "one") == hashlib.sha256(b"12").hexdigest()
    for path in (tmp_path, tmp_path / "none", "/dev/zero", "x" * 300, "nul\0"):
        assert digest(path) is None


def test_a_lock_that_a_dead_process_left_is_taken_over(tmp_path: Path) -> None:
    output = tmp_path / ("x" * 250)
    with output_lock(output):
        (left,) = tmp_path.iterdir()
    left.touch()
    with output_lock(output):
        pass
    assert list(tmp_path.iterdir()) == []


def test_never_two_makers_whoever_removes_the_lock_file(tmp_path: Path) -> None:
    """Waiters who get the lock on a file that has been removed meanwhile have a lock on nothing."""
    inside, turns = list[int](), list[int]()

    def work(maker: int) -> None:
        for _ in range(100):
            with output_lock(tmp_path / "a.tif"):
                inside.append(maker)
                turns.append(len(inside))
                inside.pop()

    with ThreadPoolExecutor(4) as pool:
        list(pool.map(work, range(4)))
    assert turns == [1] * 400
    assert list(tmp_path.iterdir()) == []


def test_a_line_that_no_render_has_written_ends_the_reading(tmp_path: Path) -> None:
    with (tmp_path / NAME).open("wb") as file:
        file.truncate(3 << 30)
    with pytest.raises(OSError, match="65536 bytes or more"):
        Journal(tmp_path).of("a.tif")


# --- keys ----------------------------------------------------------------------------------------

EVEN = Shading((((1.0,) * 4,) * 4,) * 4, (13, 17), 35, 0.01)
COLOURS: dict[str, Any] = {
    "camera_to_xyz": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "neutral": (0.5, 1, 0.6),
    "neutral_estimated": True,
}
MEASURED: dict[str, Any] = {
    "gamma": (0.9, 1.1, 0.8),
    "noise": NoiseModel.gaussian(0.01, 4),
    "defects": ((1, 2),),
    "shading": EVEN,
}
CALIBRATION = SensorCalibration.of_bits(12, sensor="bench", **COLOURS, **MEASURED)
CAMERA = Camera(CALIBRATION, CfaPattern.bayer(), {"shading": {"frames": 4}}, (13, 17))
KIND, BALANCE = PictureKind("jpg", 8, "srgb", 90), WhiteBalance("", (1.0, 2.0, 1.0))
WHOLE: dict[str, Any] = {"folder": Path("out"), "preset": "best", "exposure": 0.5, "run": "1"}
WHOLE |= {"kind": KIND, "camera": CAMERA, "white": BALANCE}
ORDERS = [Order(**WHOLE), BurstOrder(**WHOLE, reference=1, shifts=((0.0, 0.0), (1.0, 0.0)))]
LIMITS = {"folder", "run", "resume", "overwrite", "dry_run"}  # in which nothing of a picture shows
NO_MATTER = {Order: LIMITS | {"max_pixels"}, BurstOrder: LIMITS}


def key_of(order: Order) -> str:
    return order.key(Path(order.folder) / "a.jpg", "")


@pytest.mark.parametrize("order", ORDERS)
def test_every_field_that_changes_a_picture_changes_its_key(
    order: Order, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(offline.PRESETS, "changed", offline.PAPER)  # whose name it is
    changed = dict(one_field_changed(order))
    assert {"camera.measured", "kind.quality", "white.kind"} <= changed.keys()
    whole = key_of(order)
    same = {name for name, other in changed.items() if _key_in(order.folder, other) == whole}
    assert same == NO_MATTER[type(order)]
    assert NO_MATTER[type(order)] == order.no_matter
    keys = [_key_in(order.folder, other) for other in changed.values()]
    # no two of them are the same either
    assert len(set(keys) - {whole}) == len(changed) - len(same)


def _key_in(folder: Path, order: Order) -> str:
    """The key of an order, wherever its folder is."""
    object.__setattr__(order, "folder", folder)
    return key_of(order)


def test_every_setting_of_the_render_changes_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    keys = {key_of(Order(**WHOLE))}
    settings = dict(one_field_changed(offline.BEST))
    names = {field.name for field in fields(offline.BEST)}
    assert names == {name.partition(".")[0] for name in settings}
    for other in settings.values():
        monkeypatch.setitem(offline.PRESETS, "best", other)
        keys.add(key_of(Order(**WHOLE)))
    monkeypatch.setattr("panchroma.offline.version.ALGORITHM", -1)
    keys.add(key_of(Order(**WHOLE)))
    assert len(keys) == len(settings) + 2
