"""The search: which tiles it sees, and that it does not depend on interruptions."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from shared.errors import InputError
from tools.evaluation.design.judge import FastJudge, Figures, Light
from tools.evaluation.design.proposals import spearman
from tools.evaluation.design.search import Judged, Limits, Search, Tile, canonical, small_tiles

LIMITS = Limits("RGB", (3, 4), 0.6, 0.9)


def search(judged: Judged, limits: Limits = LIMITS, seed: int = 0) -> Search:
    return Search(judged, limits, {"whole": 1.0, "worst": 1.0}, 30, seed)


@pytest.fixture(scope="module")
def judge() -> FastJudge:
    return FastJudge.of("RGB", [Light.of_sigma(0.01)])


def alike(tile: Tile) -> set[Tile]:
    """All tiles that a 3 x 3 tile becomes, one step after the other."""
    found, waiting = set(), [np.array([list(row) for row in tile])]
    while waiting:
        each = waiting.pop()
        if (name := tuple("".join(row) for row in each)) not in found:
            found.add(name)
            exchanged = np.where(each == "R", "B", np.where(each == "B", "R", each))
            waiting += [np.roll(each, 1, 0), np.roll(each, 1, 1), each.T, each[::-1], exchanged]
    return found


def test_small_tiles_are_all_tiles_up_to_symmetry() -> None:
    texts = (text for text in map("".join, product("RGBW", repeat=9)) if text.count("W") == 5 and {*"RGB"} <= {*text})
    every = {(text[:3], text[3:6], text[6:]) for text in texts}
    found = list(small_tiles(3, 4, "RGB"))
    covered = [alike(tile) for tile in found]
    assert set().union(*covered) == every
    assert sum(map(len, covered)) == len(every)  # none twice
    assert all({canonical(each, "RGB") for each in tiles} == {tile} for tile, tiles in zip(found, covered, strict=True))


def test_an_interrupted_search_ends_as_one_that_was_not(judge: FastJudge, tmp_path: Path) -> None:
    straight = search(Judged(judge))
    wanted = straight.run()
    asked: list[Tile] = []

    def impatient(tile: Tile) -> list[Figures]:
        if len(asked) in (7, 60):
            asked.append(tile)
            raise KeyboardInterrupt
        asked.append(tile)
        return judge(tile)

    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            search(Judged(impatient, "judge", tmp_path / "state.json")).run()
    resumed = search(Judged(impatient, "judge", tmp_path / "state.json"))
    assert resumed.run() == wanted
    assert [resumed.score(tile) for tile in wanted] == [straight.score(tile) for tile in wanted]
    assert len(asked) == len(wanted) + 2  # nothing was judged twice but what was interrupted
    assert search(Judged(judge), seed=1).run() != wanted
    assert Judged(impatient, "another judge", tmp_path / "state.json").known == {}


def test_the_best_tile_is_the_best_of_all_and_within_the_limits(judge: FastJudge) -> None:
    seen = search(Judged(judge))
    found = seen.run()
    scores = [seen.score(tile) for tile in found]
    assert scores == sorted(scores, reverse=True)
    assert all(0.6 <= "".join(tile).count("W") / len(tile) ** 2 <= 0.9 for tile in found)
    rows = search(Judged(judge), Limits("RGB", (4,), 0.5, 0.9, ("XX", "WW"))).run()
    assert rows
    assert all(set(tile[1] + tile[3]) == {"W"} for tile in rows)
    many = Search(Judged(FastJudge.of("HIJKLNOP", [Light.of_sigma(0.01)])), Limits("HIJKLNOP", (5,)), {"whole": 1.0}, 3, 0).run()
    assert all(set("".join(tile)) == set("HIJKLNOPW") for tile in many)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("RRG", (4,)), "different letters"),
        (("RGW", (4,)), "without W"),
        (("rgb", (4,)), "A to Z"),
        (("RGB", (2,)), "`sizes` holds 2"),
        (("RGB", (4,), 0.9, 0.5), "`share`"),
        (("RGB", (4, 5), 0.5, 0.9, ("XW", "WW")), "does not divide `sizes` 5"),
        (("RGB", (4,), 0.5, 0.9, ("XW", "W")), "differ in length"),
    ],
)
def test_limits_that_cannot_be_are_refused(settings: tuple, words: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=words):
        Limits(*settings)


def test_what_cannot_be_found_or_read_is_said(judge: FastJudge, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no tile meets these limits"):
        search(Judged(judge), Limits("RGB", (3,), 0.95, 1.0)).run()
    (tmp_path / "state.json").write_text("[]")
    with pytest.raises(InputError, match="delete it"):
        Judged(judge, "", tmp_path / "state.json")


def test_rank_correlation() -> None:
    assert spearman([1, 2, 3, 4], [10, 20, 30, 40]) == pytest.approx(1)
    assert spearman([1, 2, 3, 4], [4, 3, 2, 1]) == pytest.approx(-1)
    assert spearman([1, 2, 2, 3], [1, 2, 2, 3]) == pytest.approx(1)
    assert np.isnan(spearman([1, 1], [1, 2]))
