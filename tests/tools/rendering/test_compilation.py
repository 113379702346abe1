"""What the user hears of a compilation: that it takes place, once, how far it is, and for which stage."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import pytest

import offline
from tools.host.progress import LineProgress, StageProgress
from tools.rendering import compilation as product


@pytest.fixture
def compiles(monkeypatch: pytest.MonkeyPatch) -> list[Callable[[int, int], None]]:
    """The listeners that wait for a compilation; times between remarks are zero."""
    listening = []

    @contextmanager
    def compilation(begins: Callable[[int, int], None]) -> Iterator[None]:
        listening.append(begins)
        yield

    monkeypatch.setattr(offline, "compilation", compilation)
    monkeypatch.setattr(product, "_BETWEEN_NOTES", 0.0)
    monkeypatch.setattr("tools.host.progress._BETWEEN_REMARKS", 0.0)
    return listening


def run(progress: StageProgress, compiles: list[Callable[[int, int], None]]) -> list[str]:
    notes: list[str] = []
    progress.note = notes.append
    with product.announced_compilation(progress):
        progress.stage("luminance", 1)
        compiles[0](1, 3)
        progress.stage("colour", 1)
        progress.part("affinity")
        compiles[0](2, 3)
    assert notes[0].startswith("compiling the renderer for this processor")
    return notes[1:]


def test_the_display_says_how_far_it_is_and_for_which_stage(
    compiles: list[Callable[[int, int], None]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(LineProgress("x.dng"), compiles) == []
    assert [line for line in capsys.readouterr().err.splitlines() if "compiling" in line] == [
        "x.dng: luminance, compiling kernel 1 of at most 3",
        "x.dng: colour (affinity), compiling kernel 2 of at most 3",
    ]


def test_without_a_display_notes_do(compiles: list[Callable[[int, int], None]]) -> None:
    assert run(StageProgress(), compiles) == [
        "compiling kernel 1 of at most 3: luminance",
        "compiling kernel 2 of at most 3: colour (affinity)",
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
