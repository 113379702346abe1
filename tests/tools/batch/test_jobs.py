"""Many files one after the other: which results may be written, and what the failure of one means for the rest."""

import errno
import json as json_format
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

import pytest

from panchroma.shared.errors import InputError, OutputError
from panchroma.tools.batch.console import Console, StandardOutputError
from panchroma.tools.batch.folders import Source, plan
from panchroma.tools.batch.jobs import Job, Outcome, output_folder, run_jobs
from panchroma.tools.batch.progress import StageProgress
from tests.tools.command import run

Said = pytest.CaptureFixture[str]


def do(sources: Sequence[str | Path], folder: Path, *, overwrite: bool = False, json: bool = False, work: Any = None) -> int:
    """Jobs that write their source's name; the exit code."""

    def write(job: Job, listener: StageProgress) -> Outcome:
        for output in job.outputs:
            output.write_text(job.source)
        return Outcome({"size": len(job.source)})

    jobs = plan([Source(str(source)) for source in sources], lambda source: [f"{Path(source).stem}.out"], folder)
    return run_jobs(jobs, work or write, Console(json=json), overwrite=overwrite)


def test_every_job_is_done(tmp_path: Path, capsys: Said) -> None:
    assert do(["one.in", "sub/two.in"], tmp_path, json=True) == 0
    assert sorted(path.read_text() for path in tmp_path.iterdir()) == ["one.in", "sub/two.in"]
    records = '{"source": "one.in", "ok": true, "size": 6}\n{"source": "sub/two.in", "ok": true, "size": 10}\n'
    assert capsys.readouterr() == (records, "")


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InputError("is odd"), "panchroma: bad.in: is odd"),
        (InputError("bad.inside is odd"), "panchroma: bad.in: bad.inside is odd"),
        (InputError("bad.in: is odd"), "panchroma: bad.in: is odd"),
        (OutputError("the disk\n  is full"), "panchroma: bad.in: the disk is full"),
        (MemoryError(), "panchroma: bad.in: not enough memory for a picture of this size"),
        (IndexError("odd"), "panchroma: bad.in: a fault of Panchroma, please report it: IndexError in parallel.py:"),
    ],
)
def test_one_failure_is_one_line_and_the_rest_goes_on(tmp_path: Path, capsys: Said, error: Exception, line: str) -> None:
    done: list[str] = []

    def work(job: Job, listener: StageProgress) -> Outcome:
        if job.source == "bad.in":
            raise error
        done.append(job.source)
        return Outcome()

    assert do(["one.in", "bad.in", "two.in"], tmp_path, work=work, json=True) == 1
    assert done == ["one.in", "two.in"]
    shown = capsys.readouterr()
    said = " ".join(shown.err.split())
    assert [json_format.loads(record)["ok"] for record in shown.out.splitlines()] == [True, False, True]
    assert said.startswith(line)
    assert said.count("panchroma: ") == 1


def test_an_interrupt_and_a_lost_output_are_no_failure_of_a_file(tmp_path: Path) -> None:
    for error in (KeyboardInterrupt(), StandardOutputError(BrokenPipeError(errno.EPIPE, "Broken pipe"))):

        def work(job: Job, listener: StageProgress, error: BaseException = error) -> NoReturn:
            raise error

        with pytest.raises(type(error)):
            do(["one.in", "two.in"], tmp_path, work=work)


# --- what may be written --------------------------------------------------------------------------------------------------------


def test_nothing_is_overwritten_unless_asked_for(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "one.out").write_text("old")
    assert do(["one.in", "two.in"], tmp_path) == 1
    assert (tmp_path / "one.out").read_text() == "old"
    assert (tmp_path / "two.out").read_text() == "two.in"
    assert capsys.readouterr().err == f"panchroma: {tmp_path}/one.out: exists already; use `overwrite=True` to replace it\n"
    assert do(["one.in"], tmp_path, overwrite=True) == 0
    assert (tmp_path / "one.out").read_text() == "one.in"


@pytest.mark.parametrize("overwrite", [False, True])
def test_two_sources_of_one_stem_do_not_share_a_result(tmp_path: Path, capsys: Said, overwrite: bool) -> None:
    assert do(["a/shot.in", "b/shot.in", "c/SHOT.in"], tmp_path, overwrite=overwrite) == 1
    assert (tmp_path / "shot.out").read_text() == "a/shot.in"
    assert len(list(tmp_path.iterdir())) == 1
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("panchroma: b/shot.in: the result would have the same name as that of a/shot.in; use another")
    assert do(["one.in", "one.in"], tmp_path, overwrite=True) == 1
    assert capsys.readouterr().err == "panchroma: one.in: is given twice\n"
    assert second.startswith("panchroma: c/SHOT.in: the result would have the same name as that of a/shot.in; use another")


@pytest.mark.parametrize("overwrite", [False, True])
@pytest.mark.parametrize("link", ["itself", "symbolic", "hard", "folder"])
def test_an_input_is_never_replaced(tmp_path: Path, capsys: Said, link: str, overwrite: bool) -> None:
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
    both: list[list[str | Path]] = [[source], ["other/shot.in", source]]
    for sources in both:
        assert do(sources, folder, overwrite=overwrite) == 1
        assert source.read_text() == "precious"
        assert "shot.out: is an input; use another output folder" in capsys.readouterr().err


def test_a_folder_in_the_place_of_a_result_is_refused(tmp_path: Path, capsys: Said) -> None:
    (tmp_path / "one.out").mkdir()
    assert do(["one.in"], tmp_path, overwrite=True) == 1
    assert "one.out: is a folder; remove it" in capsys.readouterr().err


def test_results_go_to_the_top_and_subfolders_are_mirrored() -> None:
    sources = [Source("lone/z.in"), Source("in/A.IN", Path("A.IN")), Source("in/sub/c.d.in", Path("sub/c.d.in"))]
    assert plan(sources, lambda source: [f"{Path(source).stem}.out"], Path("out")) == [
        Job("lone/z.in", (Path("out/z.out"),)),
        Job("in/A.IN", (Path("out/A.out"),), found=True),
        Job("in/sub/c.d.in", (Path("out/sub/c.d.out"),), found=True),
    ]


# --- the output folder ----------------------------------------------------------------------------------------------------------


def test_the_output_folder_is_made_where_its_parent_exists(tmp_path: Path) -> None:
    folder = tmp_path / "not yet"
    assert output_folder(str(folder), dry_run=True) == folder
    assert not folder.exists()
    assert output_folder(str(folder)) == output_folder(str(folder)) == folder
    assert folder.is_dir()
    (file := tmp_path / "file").touch()
    (tmp_path / "link").symlink_to("nowhere")
    for name, words in (
        (f"{folder}/a/b", f"the folder {folder}/a does not exist; create it first: mkdir -p '{folder}/a'"),
        (str(file), f"{file}: is not a folder"),
        (f"{file}/below", f"{file} is not a folder; choose another place"),
        (f"{tmp_path}/link", f"{tmp_path}/link: is a link to nowhere, which is not there; remove the link, or name another folder"),
        (f"{tmp_path}/{'x' * 300}", "cannot be created (File name too long)"),
        ("", "is empty"),
    ):
        with pytest.raises(OutputError) as caught:
            output_folder(name)
        assert words in str(caught.value)


def test_a_folder_without_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.access", lambda *_: False)  # root may write everywhere
    with pytest.raises(OutputError, match="no permission to write in this folder; choose another"):
        output_folder(str(tmp_path))


def test_an_empty_folder_that_was_there_is_not_removed(out: Path) -> None:
    run("render", "missing", "-o", out, code=1)
    assert out.is_dir()
