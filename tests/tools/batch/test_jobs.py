"""Many files one after the other: which results may be written, and what the failure of one means
for the rest.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import pytest

from panchroma.shared.errors import InputError, OutputError
from panchroma.tools.batch.console import Console
from panchroma.tools.batch.folders import Source, plan
from panchroma.tools.batch.jobs import (
    Job,
    Outcome,
    Work,
    output_folder,
    remove_unused_folders,
    run_jobs,
)
from panchroma.tools.batch.progress import StageProgress

Output = pytest.CaptureFixture[str]


def write(job: Job, listener: StageProgress) -> Outcome:
    job.output.write_text(job.source)
    return Outcome({"size": len(job.source)})


def do(
    names: Sequence[object], folder: Path, work: Work = write, *, overwrite: bool = False
) -> int:
    """Jobs that write their source's name; the exit code."""
    sources = [Source(str(name)) for name in names]
    jobs = plan(sources, lambda source: [f"{Path(source).stem}.out"], folder, dry_run=False)
    return run_jobs(jobs, work, Console(json=True), overwrite=overwrite)


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("is odd"), "is odd"),
        (InputError("bad.inside is odd"), "bad.inside is odd"),
        (InputError("bad.in: is odd"), "is odd"),
        (OutputError("the disk\nis full"), "the disk is full"),
        (MemoryError(), "not enough memory for a picture of this size"),
        (IndexError("odd"), "a fault of Panchroma, please report it: IndexError in parallel.py:"),
    ],
)
def test_one_failure_is_one_line_and_the_rest_goes_on(
    tmp_path: Path, capsys: Output, error: Exception, line: str
) -> None:
    def work(job: Job, listener: StageProgress) -> Outcome:
        if job.source == "bad.in":
            raise error
        return write(job, listener)

    assert do(["one.in", "bad.in", "two.in"], tmp_path, work) == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one.out", "two.out"]
    shown = capsys.readouterr()
    assert [json.loads(record)["ok"] for record in shown.out.splitlines()] == [True, False, True]
    assert shown.err.startswith(f"panchroma: bad.in: {line}")
    assert shown.err.count("\n") == 1


# --- what may be written -------------------------------------------------------------------------


@pytest.mark.parametrize("overwrite", [False, True])
def test_two_sources_of_one_stem_do_not_share_a_result(
    tmp_path: Path, capsys: Output, overwrite: bool
) -> None:
    assert do(["a/shot.in", "b/shot.in", "c/SHOT.in"], tmp_path, overwrite=overwrite) == 1
    assert (tmp_path / "shot.out").read_text() == "a/shot.in"
    assert len(list(tmp_path.iterdir())) == 1
    lines = capsys.readouterr().err.splitlines()
    same = "the result would have the same name as that of a/shot.in"
    # on many disks names that differ only in case are one file
    assert [same in line for line in lines] == [True, True]


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("link", ["itself", "symbolic", "hard", "folder"])
def test_an_input_is_never_replaced(
    tmp_path: Path, capsys: Output, link: str, overwrite: bool
) -> None:
    source, folder = tmp_path / "shot.out", tmp_path
    source.write_text("precious")
    if link != "itself":
        folder = tmp_path / "results"
        folder.symlink_to(tmp_path) if link == "folder" else folder.mkdir()
        if link == "symbolic":
            (folder / "shot.out").symlink_to(source)
        elif link == "hard":
            (folder / "shot.out").hardlink_to(source)
    # Not only an input's own result: that of any other source too.
    for sources in ([source], ["other/shot.in", source]):
        assert do(sources, folder, overwrite=overwrite) == 1
        assert source.read_text() == "precious"
        assert "shot.out: is an input; use another output folder" in capsys.readouterr().err


def test_a_folder_in_the_place_of_a_result_is_refused(tmp_path: Path, capsys: Output) -> None:
    (tmp_path / "one.out").mkdir()
    assert do(["one.in"], tmp_path, overwrite=True) == 1
    assert "one.out: is a folder; remove it" in capsys.readouterr().err


# --- the output folder, see also tests/tools/commands/test_refusals.py ---------------------------


def test_an_output_folder_without_permission_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write everywhere
    with pytest.raises(OutputError, match="no permission to write in this folder; choose another"):
        output_folder(str(tmp_path))


@pytest.mark.parametrize("below", ["new", "new/of/two", "there/new/one"])
def test_an_output_folder_is_created_with_its_parents_and_removed_if_nothing_came_into_it(
    tmp_path: Path, below: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "there").mkdir()
    monkeypatch.chdir(tmp_path)
    for folder in (below, f"{tmp_path}/{below}"):
        assert output_folder(folder, dry_run=True) == Path(folder)
        assert [path.name for path in tmp_path.rglob("*")] == ["there"]
        assert output_folder(folder).is_dir()
        remove_unused_folders()
        assert [path.name for path in tmp_path.rglob("*")] == ["there"]
    result = output_folder(below) / "a.tif"
    result.touch()
    remove_unused_folders()
    assert result.exists()
