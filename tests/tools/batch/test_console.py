"""What is shown, and where: results, records, remarks and bars, each on lines of its own.

Signals that end a program, in order. What a command in the middle of its work does: see
tests/faults.
"""

import io
import logging
import os
import signal
import sys
from contextlib import suppress

import pytest

from panchroma.tools.batch.console import LOG, Console, one_line, shown_by
from panchroma.tools.batch.jobs import Job, Outcome, run_jobs
from panchroma.tools.batch.progress import LineProgress, StageProgress
from panchroma.tools.batch.signals import Terminated, orderly_end
from tests.tools.command import spawn

# --- console --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("two\nlines", "two lines"),
        ("a\r\n\tb", "a b"),
        ("\x1b[31mred\x9b", r"\x1b[31mred\x9b"),
        ("bell\a, delete\x7f, nul\0", r"bell\x07, delete\x7f, nul\x00"),
        ("a\u2028b\u2029c\x85d", "a b c d"),
        ("gpj\u202e.exe\u2066 \ufeff\u200b", r"gpj\u202e.exe\u2066 \ufeff\u200b"),
        ("no text: \udcff", r"no text: \udcff"),
        ("two  blanks é 写真 \u00a0", r"two  blanks é 写真 \xa0"),
    ],
)
def test_a_line_stays_a_line_and_does_not_move_the_cursor(text: str, line: str) -> None:
    assert one_line(text) == line


@pytest.mark.parametrize("quiet", [False, True])
@pytest.mark.parametrize("json", [False, True])
def test_machines_read_stdout_people_stderr_and_quiet_leaves_errors(
    json: bool, quiet: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    out = Console(json=json, quiet=quiet)
    out.say("a result")
    out.note("a note")
    out.record(source="x", ok=True)
    with out.progress("x") as progress:
        progress.stage("luminance", 1)
    out.error("a fault")
    shown = capsys.readouterr()
    assert shown.out == ('{"source": "x", "ok": true}\n' if json else "a result\n")
    *remarks, fault = shown.err.splitlines()
    assert fault == "panchroma: a fault"
    results = ["a result"] if json else []
    assert remarks == ([] if quiet else [*results, "a note"])


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_terminal_shows_a_bar_whatever_the_file_is_called_and_results_go_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Square brackets are markup to rich, and what goes to stdout belongs above its bar, unless it
    is told otherwise.
    """
    terminal, file = Terminal(), io.StringIO()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setattr(sys, "stdout", file)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    shown = Console(json=True)
    with shown.progress("[/shot] [bold]x.dng") as progress:
        progress.stage("luminance", 3)
        progress.advance(3)
        shown.record(source="a.dng", ok=True)
    assert "[/shot] [bold]x.dng: luminance" in terminal.getvalue()
    assert file.getvalue() == '{"source": "a.dng", "ok": true}\n'
    assert "a.dng" not in terminal.getvalue()


def test_the_log_gets_a_line_per_stage_that_has_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a terminal with `verbose`, too; what was logged before and after is not shown."""
    monkeypatch.setattr(sys, "stderr", terminal := Terminal())
    shown = Console(verbose=True)
    with shown_by(shown.note, logging.INFO):
        with shown.progress("x.dng") as progress:
            progress.stage("luminance", 3)
            progress.advance(3)
            progress.stage("writing", 1)
        failing = shown.progress("y.dng")
        failing.stage("luminance", 3)
        failing.__exit__(ValueError, ValueError("odd"), None)
    with shown_by(shown.note, logging.WARNING):
        LOG.info("hidden")
        LOG.warning("use `overwrite=True`\x1b")
    LOG.info("hidden")
    *lines, note = terminal.getvalue().splitlines()
    assert [line.rsplit(" ", 2)[0] for line in lines] == ["x.dng: luminance:", "x.dng: writing:"]
    assert note == r"use `overwrite=True`\x1b"


def test_a_pipe_hears_of_long_work_once_a_minute(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = iter([0.0, 10.0, 69.0, 71.0, 71.0, 100.0, 131.0, 131.0])
    monkeypatch.setattr("panchroma.tools.batch.progress.time.monotonic", lambda: next(now))
    progress = LineProgress("x")
    progress.stage("compiling", 9)
    for number in range(4):
        progress.remark(f"{number} of 9")
    lines = ["x: compiling, 1 of 9", "x: compiling, 3 of 9"]
    assert capsys.readouterr().err.splitlines() == lines


def test_a_record_holds_no_control_character(capsys: pytest.CaptureFixture[str]) -> None:
    Console(json=True).record(name="\x7f\x1b\n\x9b\udcff")
    assert capsys.readouterr().out == '{"name": "\\u007f\\u001b\\n\\u009b\\udcff"}\n'


# --- signals --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_becomes_an_interruption_with_its_code(number: signal.Signals, code: int) -> None:
    before = signal.getsignal(number)
    with pytest.raises(Terminated) as caught, orderly_end():
        os.kill(os.getpid(), number)
    assert caught.value.code == code
    assert isinstance(caught.value, KeyboardInterrupt)
    assert signal.getsignal(number) == before


@pytest.mark.parametrize("imported", [False, True])
def test_a_signal_that_is_swallowed_ends_the_run_before_the_next_file(imported: bool) -> None:
    """An import of a C extension turns it into an error."""
    begun = []

    def work(job: Job, listener: StageProgress) -> Outcome:
        begun.append(job.source)
        with suppress(Terminated):
            os.kill(os.getpid(), signal.SIGTERM)
        if imported:
            raise ImportError("initialization failed")
        return Outcome()

    with pytest.raises(Terminated), orderly_end():
        run_jobs([Job("one", ()), Job("two", ())], work, Console())
    assert begun == ["one"]
    with pytest.raises(ImportError), orderly_end():  # the next run starts without it
        raise ImportError


def test_who_has_decided_otherwise_is_obeyed() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with orderly_end():
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_the_program_leaves_shows_nothing(number: signal.Signals) -> None:
    """After its work: while threads are joined, and modules are taken down."""
    script = f"""
import signal
from panchroma.tools.batch.signals import orderly_end
signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever the program that runs the tests had
with orderly_end(last=True):
    pass
signal.raise_signal({int(number)})  # in this thread: another one may get that of `os.kill` after the end
raise SystemExit(0)
"""
    assert spawn(script=script, code=-number).err == ""
