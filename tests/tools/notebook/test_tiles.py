"""Tiles in a notebook."""

import pytest

import panchroma


def test_the_best_tiles_are_drawn_and_can_be_simulated() -> None:
    found = panchroma.design(sigma=0.03, sizes=[3], steps=5, seed=1)
    drawn = found._repr_html_()
    assert drawn.count("<svg") == 8
    assert all(pattern in drawn for pattern in found.patterns[:8])
    assert list(found.scores) == sorted(found.scores, reverse=True)
    assert panchroma.simulate("builtin:60x60", pattern=found.patterns[0]).mosaic.pattern.period == 3
    with pytest.raises(panchroma.PanchromaError, match="`sizes` holds 99"):
        panchroma.design(sizes=[99])
