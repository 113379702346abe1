"""A small part of each campaign: two hundred damaged files, all bombs, forty extreme scenes."""

import json
import zlib
from collections import Counter
from pathlib import Path

from tests.fuzz import bombs, campaign, scenes
from tests.fuzz.campaign import ALTERED, REFUSED, SAME
from tests.fuzz.corpus import corpus
from tests.fuzz.sweep import FAULT
from tests.python import run_python


def test_no_damage_does_harm() -> None:
    results = list(campaign.run(seed=2014, numbers=range(200)))
    assert [result for result in results if result.outcome == FAULT] == []
    assert len(results) == 200
    assert {result.kind for result in results} == {sample.kind for sample in corpus()}
    counts = Counter(result.outcome for result in results)
    assert min(counts[name] for name in (SAME, ALTERED, REFUSED)) > 8


def test_bombs_are_refused_with_little_memory(tmp_path: Path) -> None:
    """All in one process, whose peak bounds that of each; of needless pieces only time would show
    that they are read.

    The command measures them one by one.
    """
    assert zlib.decompress(bombs.zeros(3_000_000)) == bytes(3_000_000)
    paths = [bombs.write(name, tmp_path) for name in bombs.bombs()]
    script = (
        "import json, sys; from pathlib import Path; from tests.fuzz.bombs import measure\n"
        "print(json.dumps({Path(name).name: measure(Path(name)) for name in sys.argv[1:]}))"
    )
    results = json.loads(run_python(script, *paths))
    assert max(grown for *_, grown in results.values()) < bombs.LIMIT_BYTES
    assert [name for name in bombs.PIECES if not results[name][0]] == []


def test_extreme_scenes_end_in_pictures() -> None:
    cases = [scenes.case(2014, number) for number in range(40)]
    assert {case.way for case in cases} == set(scenes.WAYS)
    for case in cases:
        assert scenes.outcome(case) == (scenes.RIGHT, ""), str(case)
