"""The memory and the processors that are left to this process, by every limit that holds for it.

Rendering within a limit of memory: estimates that hold, refusals with a remedy, and a word while
it compiles.
"""

from pathlib import Path

import numpy as np
import pytest

from panchroma import offline
from panchroma.offline import BEST, PAPER, PRESETS
from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
from panchroma.shared import processors as counted
from panchroma.tools.batch import compilation as product
from panchroma.tools.batch.memory import available_memory, format_bytes, needed_memory, parse_bytes
from panchroma.tools.batch.progress import StageProgress
from panchroma.tools.io.formats import FORMATS
from panchroma.tools.io.kind import PictureKind
from tests.python import run_python
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, names, run

# --- memory ---------------------------------------------------------------------------------------

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


# --- checks ---------------------------------------------------------------------------------------

LARGE = (1700, 1500)


def mosaic(shape: tuple[int, int]) -> Mosaic:
    """A busy one of 12 bits."""
    codes = np.random.default_rng(0).integers(300, 4000, shape, np.uint16)
    levels = SensorCalibration(black_level=(256.0,) * 4, white_level=4095)
    return Mosaic(codes, CfaPattern.bayer(), levels)


# --- how much ------------------------------------------------------------------------------------


def test_sizes_are_read_and_shown_rounded_up() -> None:
    sizes = {"1": 1, "3K": 3072, "800M": 800 << 20, "1.5g": 3 << 29, "1TB": 1 << 40}
    assert {option: parse_bytes(option) for option in sizes} == sizes
    for wrong in ("", "0", "-1G", "4 G", "4X", "0.0M"):
        with pytest.raises(ValueError):  # noqa: PT011  the command says what is expected
            parse_bytes(wrong)
    words = {1: "1 MB", 900 << 20: "900 MB", 1 << 30: "1.0 GB", (1 << 30) + 1: "1.1 GB"}
    assert {size: format_bytes(size) for size in words} == words


@pytest.mark.skipif(
    not Path("/proc/self/status").exists(), reason="peak memory is read as Linux tells it"
)
@pytest.mark.parametrize(
    ("name", "bits", "preset"),
    [("tif", "16", "best"), ("jxl", "32", "paper"), ("dng", "16", "paper"), ("exr", "32", "paper")],
)
def test_no_more_memory_is_taken_than_was_foreseen(
    tmp_path: Path, out: Path, name: str, bits: str, preset: str
) -> None:
    shot = save_mosaic(tmp_path / "shot.dng", mosaic(LARGE))
    script = (
        "import re; from pathlib import Path; from panchroma.tools.cli import main\n"
        "try: main()\n"
        "finally: print(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1])"
    )
    options = f"-f {name} --bits {bits} --preset {preset}".split()
    printed = run_python(script, "render", shot, "-o", out, *options)
    peak = int(printed.splitlines()[-1]) * 1024
    foreseen = needed_memory(mosaic(LARGE), PictureKind.of(name, int(bits)), PRESETS[preset])
    assert foreseen / 2 < peak < foreseen


def test_100_megapixels_are_foreseen_to_fit_3_gigabytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a rendering of that size took when it was measured, with a photograph: 2.5 GB."""
    frame = mosaic((60, 90))
    monkeypatch.setattr(Mosaic, "shape", (8166, 12246))
    assert 2.5e9 < needed_memory(frame, PictureKind.of("tif"), BEST) < 3e9


# --- what does not fit ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", FORMATS)
def test_what_does_not_fit_is_refused_with_what_would_be_enough(
    out: Path, tmp_path: Path, name: str
) -> None:
    frame = mosaic((600, 450))
    shot = save_mosaic(tmp_path / "shot.dng", frame)
    need = needed_memory(frame, PictureKind.of(name), PAPER)
    options = f"-f {name} --preset paper --max-memory"
    outcome = run("render", shot, "-o", out, f"{options} {need - 1}")
    enough = format_bytes(need).replace(" ", "").removesuffix("B")
    assert_refused(outcome, f"set --max-memory {enough}", name=str(shot))
    assert names(out) == set()
    run("render", shot, "-o", out, f"{options} {-(-need // 2**20)}M", code=0)


# --- compiling -----------------------------------------------------------------------------------


def test_kernels_are_compiled_ahead_where_processes_share(monkeypatch: pytest.MonkeyPatch) -> None:
    missing, compiled, notes = ["one", "two", "three"], list[str](), list[str]()
    monkeypatch.setattr(offline, "kernels_to_compile", lambda: missing)

    def compile_all(names: list[str], *_: object) -> list[str]:
        compiled.extend(names)
        return names

    monkeypatch.setattr(product, "compile_all", compile_all)
    product.compile_ahead(1, StageProgress(note=notes.append))
    assert (notes, compiled) == ([], [])
    for _ in range(2):
        product.compile_ahead(2, StageProgress(note=notes.append))
        assert compiled == ["one", "two", "three"]
        assert len(notes) == 1
        missing.clear()
