"""`panchroma bench`, on tiny frames: every figure is there, and adds up."""

import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

from offline import PAPER, RenderSettings, threads, use_threads
from tests.tools.command import run
from tools.evaluation.presets import PRESETS
from tools.evaluation.speed import measure, rivals
from tools.evaluation.speed.rivals import RIVALS

TINY = ("bench", "--megapixels", "0.005", "--rounds", "2", "--frames", "2")
OURS = ["paper", "paper, band by band", "paper, DNG to 16-bit TIFF", "DNG, writing", "DNG, reading"]


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Without other programs, and without the preview's processes."""
    monkeypatch.setattr(rivals, "find_spec", lambda _: None)
    monkeypatch.setattr(measure, "measure_previews", lambda *_: {})
    before = threads()
    yield
    use_threads(before)


@pytest.mark.usefixtures("alone")
def test_what_is_not_installed_is_listed_and_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(PRESETS, "best")
    outcome = run(*TINY, "-j", "1", "--json")
    assert outcome.code == 0, outcome.err
    (record,) = outcome.records
    assert list(record["seconds"]) == OURS
    assert record["times_as_fast_as"] == {"paper": dict.fromkeys([rival.name for rival in RIVALS])}
    assert all(f"{rival.name:<34} not installed: pip install" in outcome.err for rival in RIVALS)
    assert record["environment"]["threads"] == 1
    assert {"processor", "cores", "load", "system", "python", "packages"} <= set(record["environment"])


@pytest.mark.usefixtures("alone")
def test_every_preset_is_measured_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PRESETS, "best", RenderSettings(refinement=PAPER.refinement.__class__(repetitions=1)))
    (record,) = run(*TINY, "--json").records
    assert list(record["stages"]) == list(record["times_as_fast_as"]) == ["paper", "best"]
    assert [name for name in record["seconds"] if name.startswith("best")] == [
        "best",
        "best, band by band",
        "best, DNG to 16-bit TIFF",
    ]
    for stages in record["stages"].values():
        assert list(stages) == ["luminance", "chromaticity", "affinity", "propagation", "refinement"]
    for name in ("paper", "best"):
        for number, whole in enumerate(record["seconds"][name]):
            assert 0 < sum(stage[number] for stage in record["stages"][name].values()) <= whole


@pytest.mark.filterwarnings("ignore:Please import:DeprecationWarning")  # colour-demosaicing under a newer SciPy
def test_rivals_and_preview_are_measured_where_they_are_installed() -> None:
    outcome = run(*TINY, "--json")
    assert outcome.code == 0, outcome.err
    (record,) = outcome.records
    there = [rival.name for rival in RIVALS if importlib.util.find_spec(rival.module)]
    for name, ratio in record["times_as_fast_as"]["paper"].items():
        assert (ratio is not None) == (name in there)
    for name in there:
        ours, theirs = record["seconds"]["paper"], record["seconds"][name]
        ratios = sorted(b / a for a, b in zip(ours, theirs, strict=True))
        assert ratios[0] <= record["times_as_fast_as"]["paper"][name] <= ratios[-1]
    assert [each["scale"] for each in record["preview"]] == [1, 3]
    for each in record["preview"]:
        assert 0 < each["middle"] <= each["slowest"]
        assert each["first"] > 0
        assert each["imported"] > 0


def test_several_sizes_are_a_table_of_growth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    outcome = run("bench", "--megapixels", "0.002", "0.01", "--json")
    assert outcome.code == 0, outcome.err
    (record,) = outcome.records
    small, large = record["scaling"]["paper"]
    assert small["pixels"] < large["pixels"]
    for each in (small, large):
        assert 0 < each["rendering"] < each["whole"]
        assert 2**26 < each["peak"] < 2**30
    assert "file to file s/MP" in outcome.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--rounds", "0"), "--rounds is 0, expected 1 or more"),
        (("--frames", "-2"), "--frames is -2, expected 1 or more"),
        (("--megapixels", "0"), "--megapixels is 0, expected 0.0006 to 134"),
        (("--megapixels", "3", "1000"), "--megapixels is 1000, expected"),
        (("-j", "0"), "-j is 0, expected 1 or more"),
    ],
)
def test_what_cannot_be_measured_is_refused(options: tuple[str, ...], words: str) -> None:
    outcome = run("bench", *options)
    assert outcome.code == 2
    (line,) = outcome.errors
    assert words in line
