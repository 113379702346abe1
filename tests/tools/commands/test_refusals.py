"""What no command does: it ends before its work, says in one line what is wrong, and leaves every
file and folder as it was.

The exit code of a command is 0 exactly when all of its records say `ok`; nothing made is 1.
"""

import json
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import tifffile

from panchroma.shared import Camera, CfaPattern, SensorCalibration
from tests.tools.capture.test_identity import SCENE, taken, tile_of
from tests.tools.command import contents, run
from tests.tools.commands.test_options import ARGUMENT
from tests.tools.io.files import write_dng

# --- refusals -------------------------------------------------------------------------------------

FRAMES = "--size 128x96 --pixel-format raw12"

# Wrong arguments: words of the line after that of usage.
MISSPELT = {
    "": {
        "rendr shots -o out": "panchroma: error: there is no verb rendr; did you mean render?",
        "design -o x": "panchroma: error: there is no verb design",
        "--verbos render": "panchroma: error: there is no option --verbos; did you mean --verbose?",
        "render shots": "panchroma render: error: the following arguments are required:",
        "demo x.dng": "panchroma demo: error: unexpected argument: 'x.dng'",
        "inspect shot '--\x1b[2J\nall_is_well'": r"there is no option --\x1b[2J all_is_well",
        "render --widht 3": "panchroma render: error: there is no option --widht",
        "render --exposre x --bits 9": "there is no option --exposre; did you mean --exposure?",
        "simulate -sigma 1": "simulate: error: there is no option -sigma; did you mean --sigma?",
        "identify --Pixel_Format=raw": "there is no option --Pixel_Format; did you mean --pixel-format?",
        "calibrate --corner 1,2": "there is no option --corner; did you mean --corners?",
    },
    "render shots -o out": {
        "--overwr": "there is no option --overwr; did you mean --overwrite?",  # no abbreviations
        "-f pgn": "argument -f/--format: invalid choice: 'pgn'",
    },
}
BANDS = "VRGWWW/NUGWWW/WWWWWW/WWWWWW/WWWWWW/WWWWWW"
# Command -> what is added to it -> words of the only line that says what is wrong.
USAGE = {
    "simulate builtin:24x18 -o out": {
        "--pattern K=2": "--pattern 'K=2': the tile has no panchromatic pixel",
        "--sigma -1": "--sigma is -1.0, expected 0 to 1000",
        "--light 1/0": "'1/0' is not a number, or a fraction",
        "--light=": "'' is not a number, or a fraction",
        "--seed -1": "'-1' is not a whole number from 0 on",
        "--light 2 --sigma 0": "--sigma and --light set different kinds of noise; give one of them",
        "--motion 2": "--motion needs --burst",
        "--burst 99999999999": "--burst is 99999999999, expected 1 to 1000 frames",
        "--camera=": "argument --camera: '' is not the name of a file",
        "--burst 2 --motion -1": "argument --motion: '-1' is not a number from 0 on",
        "--burst 2 --bracket 0,x": "--bracket: '0,x' is not a list of numbers with commas",
        "--camera missing.json": "missing.json: there is no such file",
        "--camera text.json": "text.json: is not JSON",
        "--camera rgbe.json": "rgbe.json: the pattern has channels RGB, the calibration RGBE:",
        "--pattern RW/WB --channels RGC": "letters 'RB'",
        "--origin 1": "argument --origin: '1' is not a row and a column, such as 2,3",
        **{f"--shading={lens}": "shading" for lens in ("", "9,0", "much", "1,2,3", "nan,0")},
    },
    "render shot.dng -o out": {
        "--bits 16 --space camera": "tif does not hold camera with 16 bits; it holds",
        "--jobs 0": "'0' is not a whole number from 1 on",
        "--jobs 1.5": "'1.5' is not a whole number from 1 on",
        "--quality 90": "the quality is 90, but tif is not compressed with loss; use jpg, jxl",
        "-f jpg --quality 0": "the quality is 0, expected 1 to 100",
        "--wb auto --space camera": "--wb is no choice here: this is the scene as measured",
        "--wb daylight": "--wb is 'daylight', expected camera, auto, the place X,Y of a grey",
        "--wb 2,0,1": "such as 2.1,1,1.6, between 0.001 and 1000",
        "--exposure 1 --space camera": "--exposure is 1 stops, but this is the scene as measured",
    },
    "preview shot.dng -o out": {"--scale 0": "--scale is 0, expected 1 or more"},
    "burst frames -o out": {
        "--shifts '0,0 2,0'": "--shifts has places for 2 of 3 shots, expected one for each",
        "--shifts '0,0 nan,0 1,1'": "--shifts are ((0.0, 0.0), (nan, 0.0)",
        "--shifts '0,0 -2,-1e9 1,1'": "expected 1000 pixels at most",
        "--reference elsewhere.dng": "--reference elsewhere.dng: is none of the shots",
    },
    "burst -o out": {
        "gone.dng": "panchroma: gone.dng: there is no such file",
        "shot.dng": "shot.dng: is one frame, expected two or more of one scene; panchroma render",
        "two": "rose-1.dng; name the files of one",
    },
    "capture builtin:64x48@9 -o out": {
        "--size 64x48": "--size does not go with builtin:64x48@9",
        "--size 64": "argument --size: '64' is not a width and a height, such as 4056x3040",
        "--new": "--new does not go with builtin:64x48@9: only a folder can already contain frames",
        "--burst 2 --frames 2": "--frames does not go with --burst",
        "--black 0": "--black does not go with builtin:64x48@9",
        "--gain 3": "--gain does not go with builtin:64x48@9",
        "--camera six.json --pattern K=8": "six.json: the pattern is RGB period 8",
    },
    "capture -o out": {
        ".": ".: frames have no header; describe them with --size, --pixel-format",
        "builtin:64x48": "'builtin:64x48' is not a built-in sensor; write builtin:WIDTHxHEIGHT@FPS",
        "builtin:4000x3000@9 --burst 999999": "that many frames of 4000 x 3000 need 22351.8 GB",
        "nowhere": "nowhere: is not a folder; SOURCE is such a folder, -, genicam:ID",
    },
    f"capture . -o out {FRAMES}": {
        "--black 2048": "--black is 2048, expected a code from 0 to 2047",
        "--black 16 --camera camera.json": "--black does not go with --camera",
    },
    "view builtin:64x48@9": {
        "--bind camera": "'camera' is not the address",
        "--bind 127.0.0.1:http": "argument --bind: '127.0.0.1:http' is not an address and a port",
        "--host https://a.example": "is not a name such as camera.example.org",
        "--host a:80": "is not a name such as camera.example.org",
        "--scale 5": "5 x 5 sensor pixels: a pattern of period 6 has 1, 2, 3, 6",
    },
    "evaluate builtin:60x60 -o out": {
        "--sigma 0,-1": "--sigma is -1.0, expected 0 to 1000",
        "--max-memory lots": "--max-memory: 'lots' is not a size",
        "--pattern ''": "--pattern: '' is not a name, or several",
        "--rival net.pt": "--rival is net.pt, expected a file that ends with .onnx",
        "--pattern mine.txt,two/mine.txt": "different patterns are called 'mine'",
        f"--pattern K=6,{BANDS}": "no scene fits patterns for RGB and for VRGNU",
    },
    "preview shot.dng": {
        "": "-o is missing: the folder for the previews",
        "--export g.txt": "g.txt: a graph has a name that ends in .onnx; write g.onnx",
        "--export g.onnx --scale 4": "has 1, 2, 3, 6",
        "shot.dng --export g.onnx": "--export writes the graph for the pattern of one shot",
        "--export missing/g.onnx": "the folder missing does not exist",
        "--export mine.onnx": "mine.onnx: exists already; ",
    },
    "calibrate": {
        "-o new.json": "nothing to calibrate from",
        "shot.dng -o .": "is a folder",
        "shot.dng -o no/camera.json": "does not exist",
        "shot.dng text.json --corners 1,2 3,4 5,6 7,8 -o new.json": "one shot",
        "shot.dng --corners 1 2 3 4 -o new.json": "is not 2 numbers with commas between them",
        "shot.dng -o shot.dng --overwrite": "is an input",
        "shot.dng -o /dev/null --overwrite": "/dev/null: is a pipe or a device, not a file",
        f"shot.dng -o {'n' * 300}.json": "n.json: cannot be written (File name too long)",
        "--chart-light D65=shot.dng -o new.json": "--chart-light names two lights",
        "--chart-light D65 -o new.json": "argument --chart-light: 'D65' is not a light",
    },
}
# Every command that writes into a folder.
NO_FOLDER = {
    "text.json": "panchroma: text.json: is not a folder; name the folder for the results",
    "text.json/below": "panchroma: text.json/below: text.json is not a folder",
    "text.json/two/below": "panchroma: text.json/two/below: text.json is not a folder",
    "''": "panchroma: the name of the output folder is empty; give ",
    "x" * 300: "the file name is too long",
    "link": "panchroma: link: is not a folder; name the folder for the results",
}
INTO = [command for command in USAGE if re.fullmatch(r"\w+ \S+ -o out", command)]
INTO += [
    "view builtin:9x9@9 -o out",
    "demo -o out",
    "identify shot.dng -o out",
    "calibrate shot.dng -o new.json --report out",
]
USAGE |= {command.removesuffix(" out"): NO_FOLDER for command in INTO}
ROWS = "wrong.txt: the rows of 'RGW/GBWW' differ in length"
USAGE["simulate builtin:24x18 -o out"]["--pattern wrong.txt"] = ROWS
USAGE["view builtin:64x48@9"]["--pattern wrong.txt"] = ROWS

# Every command that takes shots.
NO_SHOTS = {
    "gone.dng": "panchroma: gone.dng: there is no such file",
    "empty": "panchroma: empty: no .dng file is in this folder or below it",
    "/dev/null": "panchroma: /dev/null: is a pipe or a device",
    "x" * 300: f"panchroma: {'x' * 300}: cannot be read",
    "*.dng.old": "panchroma: *.dng.old: no file matches this name with wildcards",
    "''": "panchroma: a name: is empty; check the command",
}

# The same, where a file is to blame: others would have been worked on.
FILES = {
    "simulate builtin:24x18 -o out": {
        "--burst 3 --motion 2": "nothing is left; take a larger picture",
        "--pattern RXWW/GBWW/WWWW/WWWW": "has the filters X",
    },
    **dict.fromkeys(("render -o out", "preview -o out", "inspect"), NO_SHOTS),
    "evaluate -o out": dict.fromkeys(
        ("gone.npy", "builtin:60x60 --max-memory 1M"), "no scene could be read"
    ),
    "simulate -o out": {"gone.npy": "gone.npy: there is no such file"},
    "burst -o out": {
        "texts": "; none of the 2 frames can be used",
        "frames --max-memory 1M": "frames/builtin-24x18-1.dng: 3 frames of ",
    },
    "burst numbered/1.dng numbered/2.dng -o numbered": {
        "-f dng --overwrite": "panchroma: numbered/1.dng: is an input"
    },
    "identify": {
        "rgb.tif": "rgb.tif: is a picture with several colours at each pixel",
        "float.npy": "float.npy: its samples are float32",
        "none.dng": "none.dng: there is no such file",
        "text.json": "a frame without a header needs --size and --pixel-format",
        "text.json --size 9x9": "describe them with --pixel-format",
        "text.json --size 2x3 --pixel-format u16": "8 bytes are not a frame: 2 x 3 pixels",
    },
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot, a burst, camera files, and files that are none of them."""
    folder = tmp_path_factory.mktemp("bench")
    run("simulate builtin:24x18 -o", folder, code=0)
    (folder / "builtin-24x18.dng").rename(folder / "shot.dng")
    run("simulate builtin:24x18 --burst 3 -o", folder / "frames", code=0)
    for name in ("empty", "texts", "numbered"):
        (folder / name).mkdir()
    for number in (1, 2):
        (folder / "texts" / f"a-{number}.dng").write_text("no picture")
        shutil.copy(folder / "shot.dng", folder / "numbered" / f"{number}.dng")
    shutil.copytree(folder / "frames", folder / "two")
    shutil.copy(folder / "shot.dng", folder / "two" / "rose-1.dng")
    for name, pattern in (("camera.json", None), ("six.json", CfaPattern.bayer(6))):
        camera = Camera(SensorCalibration.of_bits(12), pattern)
        (folder / name).write_text(json.dumps(camera.to_json()))
    (folder / "text.json").write_text("not json")
    (folder / "link").symlink_to("nowhere")
    (folder / "rgbe.json").write_text('{"schema": 1, "channels": "RGBE"}')
    (folder / "wrong.txt").write_text("RGW\nGBWW\n")
    (folder / "mine.onnx").write_text("mine")
    (folder / "mine.txt").write_text("GRWW\nBGWW\nWWWW\nWWWW\n")
    (folder / "two" / "mine.txt").write_text("BGWW\nGRWW\nWWWW\nWWWW\n")
    tifffile.imwrite(folder / "rgb.tif", np.zeros((20, 30, 3), np.uint16), photometric="rgb")
    np.save(folder / "float.npy", np.zeros((20, 30), np.float32))
    return folder


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        pytest.param(f"{command} {more}", code, words, id=f"{command.partition(' ')[0]} {more}")
        for code, table in ((1, FILES), (2, USAGE), (2, MISSPELT))
        for command, refused in table.items()
        for more, words in refused.items()
    ],
)
def test_it_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, line: str, code: int, words: str
) -> None:
    monkeypatch.chdir(folder)
    before = contents(folder)
    outcome = run(*shlex.split(line), code=code)
    *before_it, said = outcome.err.splitlines()
    assert words in said
    assert not ARGUMENT.search(said)
    assert said.startswith("panchroma")
    program, error, _ = said.partition(": error: ")
    if error:  # of the command line itself
        (usage,) = before_it
        assert usage.startswith(f"usage: {program} ")
        assert usage.endswith(" [options]")
    assert "fault" not in outcome.err
    assert outcome.out == ""
    assert contents(folder) == before
    assert not (folder / "out").exists()


# --- exit codes -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shots, scenes and frames, whole and damaged, each kind in a folder of its own."""
    bench = tmp_path_factory.mktemp("bench")
    run("simulate builtin:60x48 --sigma 0.01 -o", bench / "shots", code=0)
    run("simulate builtin:60x48 --burst 3 --motion 1 -o", bench / "frames", code=0)
    for name in ("mixed", "foreign", "scenes", "gone", "empty"):
        (bench / name).mkdir()
    shot = bench / "shots" / "builtin-60x48.dng"
    shutil.copytree(bench / "frames", bench / "torn")
    (bench / "torn" / "builtin-60x48-2.dng").write_bytes(shot.read_bytes()[:5000])
    for name in ("a-1.dng", "a-2.dng"):
        write_dng(bench / "foreign" / name, np.full((40, 60), 1000, np.uint16))
    write_dng(bench / "mixed" / "other.dng", np.full((40, 60), 1000, np.uint16))
    shutil.copy(shot, bench / "mixed")
    shutil.copy(shot, bench / "gone")
    (bench / "gone" / "torn.dng").write_bytes(shot.read_bytes()[:5000])
    picture = np.random.default_rng(0).integers(0, 4000, (40, 60, 3)).astype(np.uint16)
    tifffile.imwrite(bench / "scenes" / "x.tif", picture, photometric="rgb")
    np.save(bench / "unnamed.npy", taken(SCENE, tile_of("RWWG/WWWW/WBWW/WWWW")))
    (bench / "text.tif").write_text("no picture")
    return bench


GOOD = (
    "render shots -o out",
    "render mixed -o out",
    "render mixed -o out -n",
    "preview shots -o out",
    "preview mixed -o out",
    "inspect mixed",
    "burst frames -o out",
    "simulate scenes -o out",
    "evaluate builtin:60x60 -o out --methods bilinear --sigma 0 -j 1",
    "capture builtin:48x36@50 --frames 2 -o out",
)
BAD = (
    "render foreign -o out",
    "render foreign -o out -n",
    "render gone -o out",
    "render empty shots -o out",
    "preview foreign -o out",
    "preview gone -o out",
    "inspect foreign",
    "inspect gone",
    "inspect --verify foreign",
    "inspect --verify gone",
    "burst foreign -o out",
    "burst torn -o out",
    "simulate text.tif -o out",
    "simulate scenes text.tif -o out",
    "identify text.tif",
    "identify unnamed.npy",
    "evaluate text.tif -o out",
    "evaluate builtin:60x60 text.tif -o out --methods bilinear --sigma 0 -j 1",
    "evaluate builtin:60x60 -o out --max-memory 1M",
    "calibrate shots -o out.json",
    "calibrate gone -o out.json",
)


@pytest.mark.parametrize("line", [*GOOD, *BAD])
def test_records_fit_the_exit_code(bench: Path, monkeypatch: pytest.MonkeyPatch, line: str) -> None:
    monkeypatch.chdir(bench)
    try:
        outcome = run(f"{line} --json")
        assert outcome.code in (0, 1)
        assert bool(outcome.errors) == (line in BAD)
        assert [record["ok"] for record in outcome.records].count(False) > 0 or line in GOOD
        assert all(record["ok"] for record in outcome.records) == (outcome.code == 0)
        assert outcome.records
        assert all(("error" in record) != record["ok"] for record in outcome.records)
        if re.match("(render|preview) foreign", line):
            (error,) = outcome.errors
            assert error.startswith("panchroma: foreign: nothing was done: ")
        made = (bench / "out").exists() and any((bench / "out").rglob("*.*"))
        assert (bench / "out").exists() == made  # no empty folder is left
    finally:
        shutil.rmtree("out", ignore_errors=True)
