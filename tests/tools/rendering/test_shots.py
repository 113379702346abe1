"""Which files a run finds, where their pictures go, and how a run is divided."""

from pathlib import Path

import pytest

from shared.errors import InputError
from tools.rendering.shots import Shard, Shot, expand


def touch(top: Path, *names: str) -> None:
    for name in names:
        (top / name).parent.mkdir(parents=True, exist_ok=True)
        (top / name).touch()


def test_folders_are_mirrored_in_order_and_files_go_to_the_top(tmp_path: Path) -> None:
    touch(tmp_path, "in/b.dng", "in/A.DNG", "in/sub/c.d.dng", "in/notes.txt", "in/.hidden.dng", "in/.git/x.dng", "lone/z.dng")
    (tmp_path / "in" / "loop").symlink_to(tmp_path / "in")
    shots, failures = expand([str(tmp_path / "lone/z.dng"), str(tmp_path / "in"), "missing.dng"], tmp_path / "out", ".tif")
    assert failures == []
    assert [(shot.source.removeprefix(f"{tmp_path}/"), shot.output.relative_to(tmp_path).as_posix()) for shot in shots] == [
        ("lone/z.dng", "out/z.tif"),
        ("in/A.DNG", "out/A.tif"),
        ("in/b.dng", "out/b.tif"),
        ("in/sub/c.d.dng", "out/sub/c.d.tif"),
        ("missing.dng", "out/missing.tif"),
    ]
    assert [shot.found for shot in shots] == [False, True, True, True, False]


def test_results_inside_the_folder_are_not_taken_for_shots(tmp_path: Path) -> None:
    touch(tmp_path, "a.dng", "out/a.dng")
    shots, _ = expand([str(tmp_path)], tmp_path / "out", ".dng")
    assert shots == [Shot(str(tmp_path / "a.dng"), tmp_path / "out" / "a.dng", found=True)]


def test_a_folder_without_shots_is_told(tmp_path: Path) -> None:
    touch(tmp_path, "sub/x.tif")
    assert expand([str(tmp_path)], tmp_path, ".tif") == ([], [(str(tmp_path), "no .dng file is in this folder or below it")])


def test_every_picture_is_in_one_shard_and_they_are_alike_in_size() -> None:
    shards = [Shard.parse(f"{index}/7") for index in range(1, 8)]
    names = [f"sub/IMG_{number:04}.tif" for number in range(1000)]
    assert all(sum(shard.has(name) for shard in shards) == 1 for name in names)
    # 143 each on average, with a standard deviation of 11.
    assert all(100 < sum(shard.has(name) for name in names) < 190 for shard in shards)


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "1/0", "-1/3", "a/b", "1/3/5", "", "1.0/2"])
def test_a_shard_that_is_none(text: str) -> None:
    with pytest.raises(InputError, match="--shard is"):
        Shard.parse(text)
