"""The memory and the processors that are left to this process, by every limit that holds for it."""

from pathlib import Path

import pytest

from panchroma.shared import processors as counted
from panchroma.tools.batch.memory import available_memory
from tests.python import run_python

GROUPS = ("system.slice/job 1/step/task", "system.slice/job 1", "system.slice", "")


def limited(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """What the system says of this process's groups, in a folder for them instead of its own."""
    membership = folder / "membership"
    membership.write_text(f"9:name=systemd:/\n0::/{GROUPS[0]}\n")
    monkeypatch.setattr(counted, "_MEMBERSHIP", membership)
    monkeypatch.setattr(counted, "_MOUNT", folder / "groups")
    return membership


@pytest.mark.parametrize("group", GROUPS)
def test_the_limit_of_a_job_counts_in_whichever_of_its_groups_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, group: str
) -> None:
    membership = limited(tmp_path, monkeypatch)
    (tmp_path / "groups/other.slice").mkdir(parents=True)
    (tmp_path / "groups/other.slice/memory.max").write_text("1\n")  # of a job of somebody else
    (folder := tmp_path / "groups" / group).mkdir(parents=True, exist_ok=True)
    assert available_memory() > 2**20
    for name, content, left in (
        ("max", "5000", 5000),
        ("current", "9000", 0),
        ("current", "3000", 2000),
        ("high", "6000", 2000),
        ("max", "max", 3000),
        # which the kernel drops first
        ("stat", "anon 2000\ninactive_file 500\nactive_file 500", 3500),
    ):
        (folder / f"memory.{name}").write_text(f"{content}\n")
        assert available_memory() == left
    for nonsense in ("0::/../../elsewhere\nnonsense\n", "0::"):
        membership.write_text(nonsense)
        assert (available_memory() > 2**20) == bool(group)


@pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_a_limit_of_the_process_counts(kind: str) -> None:
    script = (
        "import resource; from panchroma.tools.batch.memory import available_memory\n"
        f"resource.setrlimit(resource.{kind}, (3 << 30, resource.RLIM_INFINITY)); "
        "print(available_memory())"
    )
    assert 2**30 < int(run_python(script)) < 3 * 2**30


@pytest.mark.parametrize(
    ("quota", "expected"), [("150000 100000", 2), ("50000 100000", 1), ("max 100000", 8)]
)
def test_a_quota_of_processor_time_limits_the_number_of_processors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, quota: str, expected: int
) -> None:
    limited(tmp_path, monkeypatch)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(8))
    monkeypatch.setattr(counted, "_quota", counted._quota.__wrapped__)
    (folder := tmp_path / "groups" / GROUPS[1]).mkdir(parents=True)
    (folder / "cpu.max").write_text(f"{quota}\n")
    assert counted.processors() == expected
