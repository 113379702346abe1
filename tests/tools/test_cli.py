"""The command line as such: help, exit codes, streams that fail, interrupts, names that are no
text.
"""

import errno
import os
import re
import signal
import subprocess
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from unittest.mock import Mock

import pytest

from panchroma.shared.errors import InputError
from panchroma.tools import cli
from panchroma.tools.commands import inspect
from tests.data import ROOT
from tests.tools.command import assert_refused, names, results, run, spawn

SHOT = "builtin-24x18.dng"


@pytest.fixture
def shots(tmp_path: Path) -> Path:
    """A folder with one small shot."""
    run("simulate", "builtin:24x18", "-o", tmp_path / "shots", code=0)
    return tmp_path / "shots"


# --- help ----------------------------------------------------------------------------------------


def test_version() -> None:
    outcome = run("--version", code=0)
    assert (outcome.out, outcome.err) == (f"panchroma {version('panchroma')}\n", "")


def test_help_lists_every_verb() -> None:
    assert re.findall(r"^    ([a-z]+)", run("--help", code=0).out, re.MULTILINE) == list(cli.VERBS)


@pytest.mark.parametrize("verb", cli.VERBS)
def test_help_of_a_verb_says_what_it_does_and_every_option(verb: str) -> None:
    outcome = run(verb, "--help", code=0)
    assert f"usage: panchroma {verb}" in outcome.out
    assert "\nexample:\n  panchroma " in outcome.out
    assert "-q, --quiet" in outcome.out
    assert "-v, --verbose" in outcome.out
    # Not the values of Python that say nothing to a user.
    assert not re.search(r"default: *(\(\)|\[|None|False|True|==)", " ".join(outcome.out.split()))


def test_the_verb_help_is_the_option() -> None:
    for words in (("render",), ()):
        assert run("help", *words, code=0).out == run(*words, "--help", code=0).out
    assert "there is no verb nonsense" in run("help nonsense", code=2).err


def test_a_variable_that_help_names_is_an_error_where_its_value_is_none(
    shots: Path, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    named = re.findall(r"^  (PANCHROMA\w+) ", run("render --help", code=0).out, re.MULTILINE)
    assert named == ["PANCHROMA_THREADS", "PANCHROMA_MAX_PIXELS"]
    for name in named:
        with monkeypatch.context() as changed:
            changed.setenv(name, "1.5")
            (line,) = run("render", shots, "-o", out, code=2).errors
            assert f"{name} is '1.5', expected a number" in line


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["ren"], ["render"]),
        (["render", "--pre"], ["--preset"]),
        (["render", "--preset", ""], ["best", "unlearned", "paper"]),
        (["inspect", "notes.t"], ["notes.txt"]),
        (["render", "x.dng", "--camera", "notes"], ["notes.txt"]),
    ],
)
def test_bash_completes_verbs_options_values_and_files(
    words: list[str], expected: list[str], script: str, tmp_path: Path
) -> None:
    (tmp_path / "notes.txt").touch()
    line = " ".join(f"'{word}'" for word in ("panchroma", *words))
    ask = f"COMP_WORDS=({line}); COMP_CWORD={len(words)}; _shtab_panchroma"
    call = ["bash", "-c", f'{script}\n{ask}\nprintf "%s\\n" "${{COMPREPLY[@]}}"']
    done = subprocess.run(call, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.split() == expected


@pytest.fixture(scope="module")
def script() -> str:
    """The completion of bash; those of zsh and fish know as many verbs."""
    scripts = [run("completion", shell, code=0).out for shell in ("bash", "zsh", "fish")]
    assert all(f"{verb}" in script for script in scripts for verb in cli.VERBS)
    return scripts[0]


LOADED = """
import sys
from panchroma.tools.cli import main
try:
    main(sys.argv[1:])
finally:
    print(*sys.modules)
"""


@pytest.mark.parametrize(
    ("line", "heavy"),
    [
        ("--help", {"numpy"}),
        ("preview --help", {"onnxruntime"}),
        (f"inspect {SHOT}", {"numba", "scipy", "onnxruntime"}),
    ],
)
def test_a_command_does_not_load_what_it_does_not_need(
    line: str, heavy: set[str], shots: Path
) -> None:
    modules = spawn(line, script=LOADED, cwd=shots, code=0).out.splitlines()[-1].split()
    assert heavy.isdisjoint(modules)


# --- errors --------------------------------------------------------------------------------------


def test_a_package_that_is_missing_is_one_line_with_the_remedy(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    missing = ModuleNotFoundError("No module named 'scipy'", name="scipy.ndimage")
    monkeypatch.setattr("panchroma.offline.measure", Mock(side_effect=missing))
    words = "the package scipy.ndimage is not installed; install Panchroma with all that belongs "
    remedy = f"to it: pip install -e '{ROOT}[all]'"
    refused = run("render", shots / SHOT, "-o", tmp_path)
    assert_refused(refused, words + remedy, name=str(shots / SHOT))
    assert names(tmp_path) == {"shots"}


def test_a_fault_outside_of_any_file_is_one_line_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inspect, "run", Mock(side_effect=RuntimeError("odd")))
    (line,) = run("inspect", "x.dng", code=1).err.splitlines()
    place = "RuntimeError in cli.py:"  # the last place of ours
    assert line.startswith(f"panchroma: a fault of Panchroma, please report it: {place}")
    assert line.endswith(": odd")


def test_verbose_shows_the_traceback_of_a_fault(
    shots: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(source: str, max_pixels: int) -> None:
        if "missing" in source:
            raise InputError("is not there")
        raise RuntimeError(f"odd\x1b {source}")

    monkeypatch.setattr(inspect, "_shot", fail)
    words = ("inspect -q", shots / SHOT, "missing.dng", tmp_path / "other.dng")
    shown = run(*words, "--verbose", code=1).err.splitlines()
    assert [line.startswith("panchroma: ") for line in shown].count(True) == 3
    fault = "a fault of Panchroma, please report it: RuntimeError in inspect.py:"
    assert shown[0].startswith(f"panchroma: {shots / SHOT}: {fault}")
    assert "(-v shows the traceback): odd" in shown[0]
    assert shown[1] == "Traceback (most recent call last):"
    assert any(line.startswith('  File "') and line.endswith(", in fail") for line in shown)
    assert f"RuntimeError: odd\\x1b {shots / SHOT}" in shown
    assert "Traceback" not in run(*words, code=1).err


def test_options_of_every_verb_may_stand_before_it(shots: Path) -> None:
    quiet = run("inspect", shots, "--quiet", code=0)
    assert run("-q -v inspect", shots, code=0).out == quiet.out
    for alone in ((), ("-v",), ("-v -q",)):
        assert "the following arguments are required: VERB" in run(*alone, code=2).err
    assert "--scale" in run("-q preview --help", code=0).out


# --- interrupts ----------------------------------------------------------------------------------


def test_an_interrupt_while_the_program_loads_is_no_traceback() -> None:
    """The imports take longest of all that comes before the first file."""
    script = """
import builtins, signal
from panchroma.tools import cli
find = builtins.__import__
def interrupted(name, *rest, **named):
    if name.endswith('shared.errors'): signal.raise_signal(signal.SIGINT)
    return find(name, *rest, **named)
builtins.__import__ = interrupted
cli.main(['inspect', 'x.dng'])
"""
    (line,) = spawn(script=script, code=130).err.splitlines()
    assert line.startswith("panchroma: interrupted")


@pytest.mark.parametrize(
    ("verb", "thread"),
    [("preview", "preview"), ("render", "panchroma"), ("render", "ThreadPoolExecutor")],
)
def test_an_interrupt_while_a_thread_starts_ends_the_program(
    verb: str, thread: str, tmp_path: Path
) -> None:
    """Such a thread runs, but its pool does not know of it, and so does not end it."""
    script = f"""
import signal, threading
from panchroma.tools import cli
begin = threading.Thread.start
def start(self):
    begin(self)
    if self.name.startswith('{thread}'): signal.raise_signal(signal.SIGINT)
threading.Thread.start = start
cli.main()
"""
    # large enough for several threads
    run("simulate builtin:600x300 -o", tmp_path / "shots", code=0)
    threads = {**os.environ, "PANCHROMA_THREADS": "2"}
    outcome = spawn(verb, tmp_path / "shots", "-o", tmp_path, script=script, env=threads, code=130)
    assert "Traceback" not in outcome.err
    assert results(tmp_path) == {"shots"}


def test_an_interrupt_does_not_wait_for_a_shot_to_be_decoded(shots: Path, tmp_path: Path) -> None:
    script = """
import os, signal, time
from panchroma.tools import cli
from panchroma.tools.batch.order import Order
def stuck(*_):
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(1000)
Order.open = stuck
cli.main()
"""
    spawn("render", shots / SHOT, "-o", tmp_path, script=script, code=130)


# --- streams -------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", [f"inspect {SHOT}", f"inspect --json {SHOT}", "render --help"])
def test_a_reader_that_has_left_is_no_traceback(line: str, shots: Path) -> None:
    reading, writing = os.pipe()
    os.close(reading)  # before the program begins
    outcome = spawn(line, cwd=shots, stdout=writing, code=128 + signal.SIGPIPE)
    os.close(writing)
    assert [word for word in ("Traceback", "Exception", "fault") if word in outcome.err] == []


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs Linux's /dev/full")
@pytest.mark.parametrize("unbuffered", ["", "1"])
@pytest.mark.parametrize(
    "line", [f"inspect {SHOT}", "--version", "-q --version", "--help", "capture --help"]
)
def test_a_full_disk_behind_stdout_is_one_line(line: str, unbuffered: str, shots: Path) -> None:
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    with Path("/dev/full").open("wb") as full:
        outcome = spawn(line, stdout=full, cwd=shots, env=environment, code=1)
    reason = os.strerror(errno.ENOSPC)
    assert outcome.err == f"panchroma: standard output: cannot be written ({reason})\n"


@pytest.mark.parametrize("closed", [">&-", "2>&-", ">&- 2>&-"])
def test_closed_streams_are_no_trouble_and_no_files(closed: str, shots: Path, out: Path) -> None:
    shell = ("sh", "-c", f'exec "$@" {closed}', "sh")
    outcome = spawn("render -v --preset paper", shots / SHOT, "-o", out, before=shell, code=0)
    assert results(out) == {"builtin-24x18.tif"}
    assert (out / "builtin-24x18.tif").read_bytes()[:4] == b"II*\0"
    assert ("colouring pixels: " in outcome.err) == (closed == ">&-")


@pytest.mark.filterwarnings("default")
def test_a_folder_that_cannot_be_synced_is_one_remark(
    tmp_path: Path, unsynced_folders: Callable[[int], None]
) -> None:
    unsynced_folders(errno.EIO)
    outcome = run("simulate builtin:24x18 builtin:18x24 -o", tmp_path / "shots", code=0)
    (remark,) = (line for line in outcome.err.splitlines() if "cannot be synced" in line)
    assert remark.startswith(str(tmp_path))
    assert results(tmp_path / "shots") == {SHOT, "builtin-18x24.dng"}


def test_file_names_that_no_encoding_holds(shots: Path) -> None:
    (shots / SHOT).rename(shots / "é\udcff.dng")
    for encoding in ("utf-8:strict", "ascii:strict"):
        environment = {**os.environ, "PYTHONIOENCODING": encoding}
        outcome = spawn("inspect", str(shots / "é\udcff.dng"), env=environment, code=0)
        assert r"\udcff.dng" in outcome.out.splitlines()[0]


# --- what is shown -------------------------------------------------------------------------------


def test_no_command_leaves_anything_in_the_home_or_sends_anything(
    tmp_path: Path, shots: Path
) -> None:
    """onnxruntime keeps a database of what it sends, matplotlib a list of fonts. The trials of
    tests/faults do this for all.
    """
    (home := tmp_path / "home").mkdir()
    environment = {**os.environ, "HOME": str(home), "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": ""}
    for verb in (["doctor"], ["preview", shots / SHOT, "-o", tmp_path / "out"]):
        outcome = spawn(*verb, env={**environment, "PYTHONPATH": str(ROOT / "tools" / "notebook")})
        assert "Traceback" not in outcome.err
        assert list(home.rglob("*")) == []
