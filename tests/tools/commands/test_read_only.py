"""What is only looked at is not written to: a finished archive can be checked where nothing can be
written.
"""

import re
from pathlib import Path

from tests.tools.batch.examples import save_shot
from tests.tools.command import contents, names, run, spawn

# A disk below the first argument that can be read alone: whatever would write to it ends the
# program.
SCRIPT = """
import os, sys

place = sys.argv.pop(1)
kinds = ("os.mkdir", "os.remove", "os.rename", "os.link", "os.symlink", "os.rmdir", "os.chmod", "os.truncate")
really = os.access
os.access = lambda path, mode, **how: really(path, mode, **how) and not mode & os.W_OK

def watch(event, given):
    writing = event in kinds or (event == "open" and given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
    if writing and any(isinstance(path, str | bytes | os.PathLike) and os.fsdecode(path).startswith(place) for path in given[:2]):
        os.write(2, f"{event} {given}".encode())
        os._exit(99)

sys.addaudithook(watch)
from panchroma.tools.cli import main
for line in sys.argv[1:]:
    try:
        main(line.split())
    except SystemExit as ended:
        assert not ended.code, line
"""
LINES = {
    "render shots -o pictures --preset paper --resume --dry-run": "3 up to date",
    "render shots -o pictures --resume --dry-run --scheduler tcp://localhost:1": "3 to be made",
    "render shots -o new --dry-run": "3 to be made",
    "burst shots/1.dng shots/2.dng -o pictures -f png --dry-run": "shots/1.dng -> ",
    "inspect --verify shots": "3 whole, 0 damaged",
    "evaluate builtin:60x60 -o results --methods bilinear --sigma 0 --dry-run": "0 results to make",
    "evaluate builtin:60x60 -o new --methods bilinear --sigma 0 --dry-run": "1 results to make",
}


def test_a_dry_run_and_a_check_write_nothing(tmp_path: Path) -> None:
    for number, name in enumerate(("1.dng", "2.dng", "below/3.dng")):
        save_shot(tmp_path / "shots" / name, number)
    run("render", tmp_path / "shots", "--preset paper -o", tmp_path / "pictures", code=0)
    left = tmp_path / "pictures" / "below" / ".3.tif.12345678.panchroma.part"
    left.write_bytes(b"half of a picture, which the next run removes")
    run("evaluate builtin:60x60 --methods bilinear --sigma 0 -o", tmp_path / "results", code=0)
    before = contents(tmp_path)
    places = r"\b(?=(shots|pictures|results|new)\b)"
    lines = (re.sub(places, f"{tmp_path}/", line) for line in LINES)
    outcome = spawn(f"{tmp_path}/", *lines, script=SCRIPT, code=0)
    for says in LINES.values():
        assert says in outcome.out + outcome.err
    assert contents(tmp_path) == before
    assert names(tmp_path) == {"shots", "pictures", "results"}
