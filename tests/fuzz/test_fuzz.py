"""Two hundred damaged files, and the fuzzer seen to catch what it is for."""

import json
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from panchroma.offline import Rendering, RenderSettings, render
from panchroma.shared import CfaPattern, Mosaic, NoiseModel, SensorCalibration
from panchroma.shared.arrays import FloatArray
from panchroma.shared.errors import InputError
from tests.fuzz import bombs, campaign, scenes
from tests.fuzz.child import ALTERED, FAULT, REFUSED, SAME, outcome
from tests.fuzz.corpus import Read, Sample, corpus
from tests.python import run_python


def test_no_damage_does_harm() -> None:
    found = campaign.run(seed=2014, numbers=range(200))
    assert found.faults == {}
    assert sum(found.counts.values()) == 200
    kinds = {sample.kind for sample in corpus()}
    assert {kind for kind, _ in found.counts} == kinds
    assert min(sum(found.counts[kind, name] for kind in kinds) for name in (SAME, ALTERED, REFUSED)) > 8


def _refuse(path: Path) -> bytes:
    raise InputError("is odd")


@pytest.mark.parametrize(
    ("read", "sealed", "expected"),
    [
        (lambda _: b"whole", True, SAME),
        (lambda _: b"other", False, ALTERED),
        (lambda _: b"other", True, FAULT),
        (lambda path: {}[path], False, FAULT),
        (_refuse, True, REFUSED),
    ],
)
def test_outcomes(read: Read, sealed: bool, expected: str) -> None:
    sample = Sample("kind", ".x", b"", read, sealed)
    assert outcome(sample, b"whole", Path("file"))[0] == expected


@pytest.mark.parametrize(
    ("does", "says"),
    [
        ("os.abort()", "ended with -6"),
        ("time.sleep(60)", "did not answer for 0.5 s"),
        ("b'x' * 200_000_000; time.sleep(60)", "took 1"),
    ],
)
def test_a_reader_that_crashes_hangs_or_swells_is_caught(does: str, says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ready = "print(json.dumps({'ready': 1, 'bytes': 50 << 20}), flush=True)"
    script = f"import json, os, sys, time\n{ready}\nsys.stdin.readline()\nx = {does}"
    monkeypatch.setattr(campaign, "CHILD", [sys.executable, "-c", script])
    monkeypatch.setattr(campaign, "LIMIT_SECONDS", 0.5 if "200" not in does else 30.0)
    monkeypatch.setattr(campaign, "LIMIT_BYTES", 100 << 20)
    assert says in campaign.run(seed=0, numbers=[0]).faults[0]


def test_bombs_are_refused_with_little_memory(tmp_path: Path) -> None:
    """All in one process, whose peak bounds that of each; of needless pieces only time would show that they are read.

    The command measures them one by one.
    """
    assert zlib.decompress(bombs.zeros(3_000_000)) == bytes(3_000_000)
    paths = [bombs.write(name, tmp_path) for name in bombs.bombs()]
    script = (
        "import json, sys; from pathlib import Path; from tests.fuzz.bombs import measure\n"
        "print(json.dumps({Path(name).name: measure(Path(name)) for name in sys.argv[1:]}))"
    )
    found = json.loads(run_python(script, *paths))
    assert max(grown for *_, grown in found.values()) < bombs.LIMIT_BYTES
    assert [name for name in bombs.PIECES if not found[name][0]] == []


def test_extreme_scenes_end_in_pictures() -> None:
    cases = [scenes.case(2014, number) for number in range(40)]
    assert {each.way for each in cases} == set(scenes.WAYS)
    assert [(str(each), scenes.outcome(each)) for each in cases if scenes.outcome(each)[0] != scenes.RIGHT] == []


@pytest.mark.parametrize(
    ("name", "spoil", "says"),
    [
        ("random", lambda picture: picture.__setitem__((3, 4, 0), np.nan), "not finite"),
        ("random", lambda picture: picture.__setitem__((3, 4, 0), 1000.0), "wild"),
        ("black", lambda picture: picture.__setitem__((3, 4, 0), 0.01), "not black"),
        ("constant", lambda picture: picture.__setitem__((3, 4, 0), 2.0), "off by"),
        ("checker", lambda picture: picture.__imul__(1 + 0.5 * (picture.max() > 1)), "twice the light"),
    ],
)
def test_a_wrong_picture_of_an_extreme_scene_is_caught(
    name: str, spoil: Callable[[FloatArray], object], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pattern, scene = CfaPattern.bayer(6), np.full((24, 24, 3), 0.0 if name == "black" else 0.9, np.float32)
    each = scenes.Case(
        "best", name, 1.0, "exact", "none", "none", pattern, SensorCalibration(noise=NoiseModel.gaussian(0, 4)), scene, 0
    )
    assert scenes.outcome(each) == (scenes.RIGHT, "")

    def spoilt(mosaic: Mosaic, settings: RenderSettings) -> Rendering:
        made = render(mosaic, settings)
        spoil(made.rgb)
        return made

    monkeypatch.setattr(scenes, "render", spoilt)
    found, why = scenes.outcome(each)
    assert found == scenes.FAULT
    assert says in why
