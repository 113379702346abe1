"""The search for a tile, as a person or a script uses it."""

import json
from pathlib import Path

import pytest

from shared.pattern_text import read_pattern
from tests.tools.command import run

BUDGET = ("--sizes", "3", "--steps", "3", "--share", "0.6", "0.7")


def test_from_light_to_letters_and_a_page(out: Path) -> None:
    options = ("-o", out, *BUDGET, "--photons", "5000", "50", "--read-noise", "2", "--json")
    slow = ("--photographs", "builtin:120x90", "--crop", "60", "--workers", "1")
    outcome = run("design", *options, *slow, code=0)
    best, names = outcome.records[0], [record["name"] for record in outcome.records]
    assert all(read_pattern(record["pattern"]).period == 3 for record in outcome.records if record["name"].isdigit())
    assert {"1", "2", "K=6", "K=4", "kodak"} <= set(names)
    scores = [record["score"] for record in outcome.records]
    assert scores == sorted(scores, reverse=True)
    measured = [each[name] for each in best["slow"].values() for name in ("worst", "whole")]
    assert scores[0] == pytest.approx(sum(measured) / 4)
    for record in outcome.records:
        for judge in ("fast", "slow"):
            bright, dark = record[judge]["5,000 photons"], record[judge]["50 photons"]
            assert bright["whole"] > dark["whole"]
    page = (out / "design.html").read_text()
    assert all(record["pattern"] in page for record in outcome.records)
    assert "rank correlation" in page
    assert len(json.loads((out / "judged.json").read_text())["tiles"]) >= sum(map(str.isdigit, names))

    # Again: refused; with --overwrite nothing is judged or measured again.
    assert "design.html: exists already" in run("design", *options).err
    kept = {path: path.stat().st_mtime_ns for path in (out / "results").iterdir()}
    assert run("design", *options, *slow, "--overwrite").records == outcome.records
    assert {path: path.stat().st_mtime_ns for path in (out / "results").iterdir()} == kept


def test_a_photograph_that_is_not_there_is_named(out: Path) -> None:
    assert "nowhere.png" in run("design", "-o", out, *BUDGET, "--photographs", "nowhere.png", code=2).err
