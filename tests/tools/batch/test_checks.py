"""Rendering within a limit of memory: estimates that hold, refusals with a remedy, and a word while it compiles."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import offline
from offline import BEST, PRESETS, available_threads, threads, use_threads
from offline.numerics.arrays import Floats1
from offline.numerics.compile import ParallelKernel, Pieces
from shared import CfaPattern, Mosaic, SensorCalibration
from tests.python import run_python
from tests.tools.batch.examples import save_mosaic
from tests.tools.command import assert_refused, names, run
from tools.batch import checks, memory
from tools.batch import compilation as product
from tools.batch.compilation import announced_compilation
from tools.batch.memory import allowed_memory, format_bytes, parse_bytes
from tools.batch.progress import LineProgress, StageProgress
from tools.io.formats import FORMATS
from tools.io.kind import PictureKind

SMALL = (60, 90)
LARGE = (1700, 1500)


def mosaic(shape: tuple[int, int], pattern: CfaPattern | None = None) -> Mosaic:
    """A busy one of 12 bits, a small one repeated."""
    codes = np.random.default_rng(0).integers(300, 4000, (60, 60), np.uint16)
    repeated = np.tile(codes, (-(-shape[0] // 60), -(-shape[1] // 60)))[: shape[0], : shape[1]]
    return Mosaic(repeated, pattern or CfaPattern.bayer(), SensorCalibration(black_level=(256.0,) * 4, white_level=4095))


# --- how much -------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "size"), [("1", 1), ("3K", 3072), ("800M", 800 * 2**20), ("1.5g", 3 * 2**29), ("2GiB", 2**31), ("1TB", 2**40)]
)
def test_sizes_are_read(option: str, size: int) -> None:
    assert parse_bytes(option) == size


@pytest.mark.parametrize("option", ["", "0", "-1G", "4 G", "4X", "0.0M"])
def test_other_words_are_refused(option: str) -> None:
    with pytest.raises(ValueError):  # noqa: PT011  the command says what is expected
        parse_bytes(option)


def test_left_open_it_is_most_of_what_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_memory", lambda: 1000)
    assert allowed_memory(None) == 800


@pytest.mark.parametrize(("size", "words"), [(1, "1 MB"), (900 * 2**20, "900 MB"), (2**30, "1.0 GB"), (2**30 + 1, "1.1 GB")])
def test_sizes_are_rounded_up(size: int, words: str) -> None:
    assert format_bytes(size) == words


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="peak memory is read as Linux tells it")
@pytest.mark.parametrize(
    ("name", "bits", "preset"), [("tif", "16", "best"), ("jxl", "32", "paper"), ("dng", "16", "paper"), ("exr", "32", "paper")]
)
def test_no_more_memory_is_taken_than_was_foreseen(tmp_path: Path, out: Path, name: str, bits: str, preset: str) -> None:
    shot = save_mosaic(tmp_path / "shot.dng", mosaic(LARGE))
    script = (
        "import re; from pathlib import Path; from tools.cli import main\n"
        "try: main()\n"
        "finally: print(re.search(r'VmHWM:\\s+(\\d+)', Path('/proc/self/status').read_text())[1])"
    )
    said = run_python(script, "render", shot, "-o", out, "-f", name, "--bits", bits, "--preset", preset)
    peak = int(said.splitlines()[-1]) * 1024
    foreseen = checks.needed_memory(mosaic(LARGE), PictureKind.of(name, int(bits)), PRESETS[preset])
    assert foreseen / 2 < peak < foreseen


ENCODED = """
import re, sys
from pathlib import Path
from tests.tools.io.examples import encoded, scene
from tools.io.kind import PictureKind

def status(name):
    return int(re.search(name + r":\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) * 1024

kind, picture = PictureKind.of(sys.argv[1], int(sys.argv[2])), scene((1500, 1500))
encoded(picture[:9, :9], kind)  # libraries are loaded
Path("/proc/self/clear_refs").write_text("5")  # the peak begins here
before = status("VmRSS")
encoded(picture, kind)
print(status("VmHWM") - before)
"""


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="peak memory is read as Linux tells it")
@pytest.mark.parametrize(("name", "bits"), [("exr", "16"), ("png", "16")])
def test_a_picture_that_is_held_as_a_whole_takes_no_more_than_is_said(name: str, bits: str) -> None:
    """Of small frames the rendering needs more: only those of 100 megapixels would show it."""
    foreseen = FORMATS[name].memory((1500, 1500), 3, 0, 1)
    assert foreseen / 4 < int(run_python(ENCODED, name, bits)) < foreseen


def test_100_megapixels_are_foreseen_to_fit_2_gigabytes(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a rendering of that size took when it was measured, with a photograph: 2.0 GB."""
    frame = mosaic(SMALL)
    monkeypatch.setattr(Mosaic, "shape", (8166, 12246))
    assert 1.7e9 < checks.needed_memory(frame, PictureKind.of("tif"), BEST) < 2 * 2**30


# --- what does not fit ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name in FORMATS if name != "tif"])
def test_other_formats_do_not_fit_where_tiff_does(out: Path, tmp_path: Path, name: str) -> None:
    frame = mosaic((600, 450))
    shot = save_mosaic(tmp_path / "shot.dng", frame)
    need = {each: checks.needed_memory(frame, PictureKind.of(each), BEST) for each in ("tif", name)}
    limit = str((need["tif"] + need[name]) // 2)
    outcome = run("render", shot, "-o", out, "-f", name, "--max-memory", limit)
    words = f"use -f tif, which needs {format_bytes(need['tif'])}, or set --max-memory {-(-need[name] // 2**20)}M"
    assert_refused(outcome, words, name=str(shot))
    assert names(out) == set()
    run("render", shot, "-o", out, "-f", name, "--max-memory", f"{-(-need[name] // 2**20)}M", code=0)


# --- threads --------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("option", "used"), [("1", 1), ("1000", available_threads())])
def test_threads_are_those_asked_for_as_far_as_there_are(
    option: str, used: int, tmp_path: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    write = "tools.batch.attempt.write_picture"
    monkeypatch.setattr(write, lambda *_, **named: seen.append((threads(), named["threads"])))
    before = threads()
    try:
        run("render", save_mosaic(tmp_path / "shot.dng", mosaic(SMALL)), "-o", out, "-j", option, code=0)
    finally:
        use_threads(before)
    assert seen == [(used, used)]


# --- compiling ------------------------------------------------------------------------------------------------------------------


def test_without_a_place_for_kernels_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def nowhere() -> Path:
        raise RuntimeError("no locator available")

    def fresh(_: Pieces, numbers: Floats1, /) -> None:
        numbers[0] = 2

    kernel = ParallelKernel(fresh, len)
    monkeypatch.setattr("offline.kernel_cache", nowhere)
    said: list[str] = []
    with announced_compilation(StageProgress(note=said.append)):
        kernel(np.ones(1, np.float32))
        kernel(np.ones(1, np.float32))
    (line,) = said
    assert line.endswith(
        "every time: there is no folder to keep the result in; set NUMBA_CACHE_DIR to a folder that you may write to"
    )


def test_the_display_or_else_notes_say_how_far_it_is_and_for_which_stage(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    listening: list[Callable[[int, int], None]] = []

    @contextmanager
    def compilation(begins: Callable[[int, int], None]) -> Iterator[None]:
        listening.append(begins)
        yield

    monkeypatch.setattr(offline, "compilation", compilation)
    monkeypatch.setattr(product, "_BETWEEN_NOTES", 0.0)
    monkeypatch.setattr("tools.batch.progress._BETWEEN_REMARKS", 0.0)
    noted = []
    for progress in (LineProgress("x.dng"), StageProgress()):
        notes: list[str] = []
        progress.note = notes.append
        with product.announced_compilation(progress):
            progress.stage("luminance", 1)
            listening[-1](1, 3)
            progress.stage("colour", 1)
            progress.part("affinity")
            listening[-1](2, 3)
        assert notes.pop(0).startswith("compiling the renderer for this processor")
        noted.append(notes)
    assert noted == [[], ["compiling kernel 1 of at most 3: luminance", "compiling kernel 2 of at most 3: colour (affinity)"]]
    assert [line for line in capsys.readouterr().err.splitlines() if "compiling" in line] == [
        "x.dng: luminance, compiling kernel 1 of at most 3",
        "x.dng: colour (affinity), compiling kernel 2 of at most 3",
    ]


def test_kernels_are_compiled_ahead_where_processes_can_share_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    missing, compiled = ["one", "two", "three"], []

    def compile_all(names: Sequence[str], processes: int, note: Callable[[str], None]) -> Iterator[tuple[str, object]]:
        for name in names:
            compiled.append((name, processes))
            yield name, None

    monkeypatch.setattr(offline, "kernels_to_compile", lambda *settings: missing)
    monkeypatch.setattr(product, "compile_all", compile_all)
    monkeypatch.setattr(product, "_BETWEEN_NOTES", 0.0)
    notes: list[str] = []
    product.compile_ahead([offline.PAPER], 1, StageProgress(note=notes.append))
    assert (notes, compiled) == ([], [])
    product.compile_ahead([offline.PAPER], 2, StageProgress(note=notes.append))
    assert compiled == [("one", 2), ("two", 2), ("three", 2)]
    assert notes[0].startswith("compiling the renderer for this processor")
    assert notes[-1] == "compiled kernel 3 of 3: compiling"
    missing.clear()
    product.compile_ahead([offline.PAPER], 2, StageProgress(note=notes.append))
    assert len(compiled) == 3
