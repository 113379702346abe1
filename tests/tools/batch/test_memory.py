"""The memory and the processors that are left to this process, by every limit that holds for it."""

from pathlib import Path

import pytest

from panchroma.shared import control_groups
from panchroma.shared import processors as counted
from panchroma.tools.batch.memory import available_memory
from tests.python import run_python


def test_a_container_may_have_less_than_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(control_groups, "_USUAL", tmp_path)
    everything = available_memory()
    assert everything > 2**20
    kernel_drops_first = "anon 2000\ninactive_file 500\nactive_file 500\n"
    for files, left in (
        ({"current": "3000\n", "max": "5000\n"}, 2000),
        ({"max": "max\n", "high": "6000\n"}, 3000),
        ({"stat": kernel_drops_first}, 3500),
    ):
        for name, content in files.items():
            (tmp_path / f"memory.{name}").write_text(content)
        assert available_memory() == left


MEMBERSHIP = """
9:name=systemd:/
4:memory:/slurm/uid_0/job 1/step_0
3:cpu,cpuacct:/docker/abc
0::/system.slice/job.scope/step/task
"""
MOUNTS = r"""
31 23 0:28 / {place}/cgroup rw,relatime - tmpfs tmpfs rw,mode=755
35 31 0:32 / {place}/first\040version rw,relatime shared:9 - cgroup cgroup rw,memory
36 31 0:33 /docker/abc {place}/processors rw,relatime - cgroup cgroup rw,cpu,cpuacct
41 31 0:38 / {place}/second rw,relatime - cgroup2 cgroup2 rw,nsdelegate
"""


def limited(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for what the system says of this process, instead of its own."""
    process = folder / "process"
    process.mkdir()
    (process / "cgroup").write_text(MEMBERSHIP.lstrip())
    (process / "mountinfo").write_text(MOUNTS.format(place=folder).lstrip())
    monkeypatch.setattr(control_groups, "_PROCESS", process)
    monkeypatch.setattr(control_groups, "_USUAL", folder / "cgroup")
    return process


JOB = "first version/slurm/uid_0/job 1"
FIRST = (f"{JOB}/step_0", JOB, "first version")
SECOND = ("second/system.slice/job.scope/step/task", "second/system.slice", "second")


@pytest.mark.parametrize("place", FIRST + SECOND)
def test_the_limit_of_a_job_counts_in_whichever_of_its_groups_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    limit, usage = ("limit_in_bytes", "usage_in_bytes") if place in FIRST else ("max", "current")
    process = limited(tmp_path, monkeypatch)
    (tmp_path / "second/other.slice").mkdir(parents=True)
    (tmp_path / "second/other.slice/memory.max").write_text("1\n")  # of a job of somebody else
    (folder := tmp_path / place).mkdir(parents=True, exist_ok=True)
    assert available_memory() > 2**20
    (folder / f"memory.{limit}").write_text("5000\n")
    assert available_memory() == 5000
    for used, left in ((3000, 2000), (9000, 0)):
        (folder / f"memory.{usage}").write_text(f"{used}\n")
        assert available_memory() == left
    (process / "cgroup").write_text("0::/../../elsewhere\nnonsense\n")
    (process / "mountinfo").write_text("nonsense\n")
    assert available_memory() > 2**20


@pytest.mark.parametrize("kind", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_a_limit_of_the_process_counts(kind: str) -> None:
    script = (
        "import resource; from panchroma.tools.batch.memory import available_memory\n"
        f"resource.setrlimit(resource.{kind}, (3 << 30, resource.RLIM_INFINITY)); "
        "print(available_memory())"
    )
    assert 2**30 < int(run_python(script)) < 3 * 2**30


def test_what_a_slurm_job_was_granted_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SLURM_MEM_PER_CPU", "30")
    monkeypatch.setenv("SLURM_CPUS_ON_NODE", "2")
    assert available_memory() == 60 * 2**20
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "100")
    assert available_memory() == 100 * 2**20
    monkeypatch.delenv("SLURM_MEM_PER_CPU")
    monkeypatch.setenv("SLURM_MEM_PER_NODE", "0")  # --mem=0: all of the node
    assert available_memory() > 100 * 2**20


@pytest.mark.parametrize(
    ("name", "quota", "expected"),
    [
        ("processors/cpu.cfs_quota_us", "150000", 2),
        ("processors/cpu.cfs_quota_us", "-1", 8),
        ("second/system.slice/cpu.max", "50000 100000", 1),
        ("second/system.slice/cpu.max", "max 100000", 8),
    ],
)
def test_a_quota_of_processor_time_limits_the_number_of_processors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, quota: str, expected: int
) -> None:
    limited(tmp_path, monkeypatch)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: range(8))
    monkeypatch.setattr(counted, "_quota", counted._quota.__wrapped__)
    file = tmp_path / name
    file.parent.mkdir(parents=True)
    file.with_name("cpu.cfs_period_us").write_text("100000\n")
    file.write_text(f"{quota}\n")
    assert counted.processors() == expected
