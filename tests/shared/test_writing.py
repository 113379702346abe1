import errno
import fcntl
import os
import sys
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from typing import IO
from unittest.mock import Mock

import pytest

from panchroma.shared.errors import DurabilityWarning, OutputError
from panchroma.shared.writing import (
    durable_file,
    own_file,
    partial_path,
    reason,
    sweep,
    sync_folder,
    write_durably,
)
from tests.python import finished, run_python

WORDS = {
    errno.ENOSPC: "disk is full",
    errno.EACCES: "no permission",
    errno.EIO: "cannot be written",
}


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.usefixtures("links")
def test_never_overwrites_unless_told(tmp_path: Path) -> None:
    path = tmp_path / "shot.dng"
    write_durably(path, b"old")
    with pytest.raises(OutputError, match=r"shot\.dng.*exists already.*`overwrite=True`"):
        write_durably(path, b"new")
    assert path.read_bytes() == b"old"
    write_durably(path, b"new", overwrite=True)
    assert contents(tmp_path) == {"shot.dng": b"new"}


def test_a_file_that_appears_meanwhile_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "shot.dng"
    monkeypatch.setattr(os, "fsync", lambda _: path.write_bytes(b"theirs"))
    with pytest.raises(OutputError, match="exists already"):
        write_durably(path, b"ours")
    assert contents(tmp_path) == {"shot.dng": b"theirs"}


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("number", WORDS)
def test_a_failed_write_leaves_what_was_there(
    tmp_path: Path, full_disk: Callable[[int], None], number: int, overwrite: bool
) -> None:
    path = tmp_path / "shot.dng"
    if overwrite:
        path.write_bytes(b"old")
    full_disk(number)
    with pytest.raises(OutputError, match=rf"{path}: .*{WORDS[number]}"):
        write_durably(path, b"new", overwrite=overwrite)
    assert contents(tmp_path) == ({"shot.dng": b"old"} if overwrite else {})


def test_an_interruption_removes_the_temporary_file_and_passes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "fsync", Mock(side_effect=KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        write_durably(tmp_path / "shot.dng", b"new")
    assert list(tmp_path.iterdir()) == []


def test_the_content_is_on_the_disk_before_it_has_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file is synced while only the temporary name exists, then the folder with the final name
    in it.
    """
    path, seen = tmp_path / "shot.dng", []

    def record(descriptor: int) -> None:
        is_folder = Path(f"/proc/self/fd/{descriptor}").resolve().is_dir()
        seen.append((is_folder, path.exists(), [name.suffix for name in tmp_path.iterdir()]))

    monkeypatch.setattr(os, "fsync", record)
    write_durably(path, b"content")
    assert seen == [(False, False, [".part"]), (True, True, [".dng"])]


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize(
    "number", [errno.EINVAL, errno.EOPNOTSUPP, errno.ENOSYS, errno.EBADF, errno.EIO, errno.ENOSPC]
)
def test_a_folder_that_cannot_be_synced_costs_no_file_and_one_that_fails_to_is_a_warning(
    tmp_path: Path, unsynced_folders: Callable[[int], None], number: int, overwrite: bool
) -> None:
    sync_folder(tmp_path)
    unsynced_folders(number)
    fails = number in (errno.EIO, errno.ENOSPC)
    said = rf"{tmp_path}.*cannot be synced.*whole"
    # pytest makes a warning an error
    with pytest.warns(DurabilityWarning, match=said) if fails else nullcontext():
        write_durably(tmp_path / "shot.dng", b"whole", overwrite=overwrite)
    assert contents(tmp_path) == {"shot.dng": b"whole"}


def test_an_error_of_another_file_is_not_said_of_this_one(tmp_path: Path) -> None:
    other = OSError(errno.EIO, os.strerror(errno.EIO), "other")

    fail = Mock(side_effect=other)
    with pytest.raises(OSError, match="other") as caught, durable_file(tmp_path / "a") as file:
        fail(file.write(b"part"))
    assert caught.value is other
    for on_complete in (fail, lambda _: fail):  # at once, and when the file is on the disk
        with (
            pytest.raises(OSError, match="other") as caught,
            durable_file(tmp_path / "b", on_complete=on_complete) as file,
        ):
            file.write(b"whole")
        assert caught.value is other
    assert list(tmp_path.iterdir()) == []


def test_an_error_of_the_file_itself_is_said_of_it_also_in_the_block(tmp_path: Path) -> None:
    raised = pytest.raises(OutputError, match=r"shot\.dng: cannot be written")
    with raised, durable_file(tmp_path / "shot.dng") as file:
        os.close(file.fileno())
        file.write(bytes(1 << 20))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "name", ["panchroma.shared", "panchroma.device", "panchroma.offline", "panchroma.tools.cli"]
)
def test_on_windows_one_sentence_says_what_to_do(name: str) -> None:
    """A library raises it; the command prints it alone."""
    is_command = name == "panchroma.tools.cli"
    run = f"import {name}" + (f"\n{name}.main()" if is_command else "")
    done = finished(sys.executable, "-c", f"import sys\nsys.modules['fcntl'] = None\n{run}")
    assert (done.returncode, done.stdout) == (1, "")
    assert "on Windows install it in the Windows Subsystem" in done.stderr.splitlines()[-1]
    assert not is_command or done.stderr.count("\n") == 1


def test_errors_name_file_and_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    (tmp_path / "folder").mkdir()
    for name, words in (
        ("missing/shot.dng", r"missing.*does not exist; create it first: mkdir -p '?/.*missing"),
        ("file/shot.dng", "is not a folder"),
        ("x" * 300, "too long"),
        ("folder", "is a folder"),
    ):
        with pytest.raises(OutputError, match=words):
            write_durably(tmp_path / name, b"", overwrite=name == "folder")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_a_folder_that_is_there_need_not_be_created(tmp_path: Path) -> None:
    """In /proc no file can be made."""
    error = FileNotFoundError(errno.ENOENT, "No such file or directory")
    assert reason(error, tmp_path / "shot.dng") == "cannot be written (No such file or directory)"


def test_what_a_killed_process_left_is_swept_and_nothing_else(tmp_path: Path) -> None:
    partial_path(tmp_path / "shot.dng").write_bytes(b"half")
    others = [".shot.dng.part", "shot.dng.12345678.panchroma.part", ".x.1234567.panchroma.part"]
    for name in others:
        (tmp_path / name).write_bytes(b"theirs")
    fresh, old = (tmp_path / f".link.0000000{number}.panchroma.part" for number in (1, 2))
    for link in (fresh, old):
        link.symlink_to("nowhere")
    os.utime(old, (0, 0), follow_symlinks=False)
    assert sweep(tmp_path) == 2
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([*others, fresh.name])
    assert sweep(tmp_path / "absent") == 0


def test_what_is_being_written_is_not_swept(tmp_path: Path) -> None:
    with durable_file(tmp_path / "shot.dng") as file:
        file.write(b"whole")
        assert len(list(tmp_path.iterdir())) == 1
        assert sweep(tmp_path) == 0
    assert contents(tmp_path) == {"shot.dng": b"whole"}


def test_a_temporary_file_swept_before_it_was_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flock = fcntl.flock
    swept: list[Path] = []

    def late(file: IO[bytes], operation: int) -> None:
        if not swept:
            swept.extend(tmp_path.iterdir())
            swept[0].unlink()
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", late)
    write_durably(tmp_path / "shot.dng", b"whole")
    assert len(swept) == 1
    assert contents(tmp_path) == {"shot.dng": b"whole"}


# --- links, pipes, permissions -------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["rb", "ab", "ab+"])
@pytest.mark.parametrize("kind", ["link", "dangling link", "pipe", "device", "folder"])
def test_no_file_of_ours_opens_through_what_is_none(tmp_path: Path, kind: str, mode: str) -> None:
    original, path = tmp_path / "original", tmp_path / "journal"
    with own_file(original, "ab") as file:
        file.write(b"a photograph")
    links = {"link": "original", "dangling link": "new", "device": "/dev/zero"}
    if kind in links:
        path.symlink_to(links[kind])
    else:
        (os.mkfifo if kind == "pipe" else os.mkdir)(path)
    with pytest.raises(OSError, match=r"journal is no file of Panchroma .*; remove it"):
        own_file(path, mode)
    assert original.read_bytes() == b"a photograph"
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("target", ["original", "nowhere"])
def test_a_link_in_place_of_a_result_is_replaced_or_stays(tmp_path: Path, target: str) -> None:
    (tmp_path / "original").write_bytes(b"a photograph")
    (tmp_path / "original").chmod(0o600)
    path = tmp_path / "shot.dng"
    path.symlink_to(target)
    missing = "is a link to nowhere, which is not there; remove"
    words = missing if target == "nowhere" else "exists already"
    with pytest.raises(OutputError, match=words):
        write_durably(path, b"new")
    assert path.is_symlink()
    write_durably(path, b"new", overwrite=True)
    assert (path.is_symlink(), path.read_bytes()) == (False, b"new")
    assert path.stat().st_mode & 0o777 != 0o600
    assert (tmp_path / "original").read_bytes() == b"a photograph"
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444, 0o666, 0o755])
def test_a_replaced_file_keeps_its_permissions_and_its_owner(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "shot.dng"
    write_durably(path, b"old")
    path.chmod(mode)
    if os.geteuid() == 0:  # only root may give files away
        os.chown(path, 1234, 4321)
    before = path.stat()
    write_durably(path, b"new", overwrite=True)
    after = path.stat()
    assert (after.st_uid, after.st_gid) == (before.st_uid, before.st_gid)
    assert after.st_mode & 0o777 == mode
    assert path.read_bytes() == b"new"


def test_a_group_that_cannot_be_kept_gains_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "shot.dng"
    path.write_bytes(b"old")
    path.chmod(0o664)
    old = list(path.lstat())
    old[4:6] = 1234, 4321  # owner and group

    refuse = Mock(side_effect=PermissionError(errno.EPERM, "Operation not permitted"))
    monkeypatch.setattr(Path, "lstat", lambda _: os.stat_result(old))
    monkeypatch.setattr(os, "fchown", refuse)
    write_durably(path, b"new", overwrite=True)
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_name_that_is_no_utf_8_and_one_beyond_the_locale_are_written(tmp_path: Path) -> None:
    script = (
        "import os, sys\nfrom panchroma.shared.writing import write_durably\n"
        "folder = os.fsencode(sys.argv[1])\n"
        "for name in (b'caf\\xc3\\xa9', b'\\xff\\xfe', b'\\xe5\\x86\\x99' * 85):\n"
        "    write_durably(os.fsdecode(folder + b'/' + name), b'')"
    )
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0"}
    run_python(script, tmp_path, env=environment)
    assert len(list(tmp_path.iterdir())) == 3
