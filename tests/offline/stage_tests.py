"""Properties that every stage has, written once: the tests of a stage derive a class from one of
these.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from panchroma.offline import BEST, Band, Frame, RenderSettings, RowStage, measure, row_stages
from panchroma.offline.bands import run_stages
from panchroma.offline.stages.propagation import Propagation
from panchroma.shared import CfaPattern, Mosaic
from panchroma.shared.arrays import FloatArray
from tests.offline.scenes import every_case, gamma_of, shot
from tests.reference.sensor import observe

# relative: what hole filling leaves after its last iteration, and the network of blocks, with its 8
# bits
FLAT, FLAT_IN_STEPS = 2e-3, 4e-3


class StageTests(ABC):
    """Tests of a stage that sees the whole frame.

    settings: those it is run with.
    sigma: noise of the shots.
    flat: how far a flat scene's result may vary, relative to it.
    """

    settings: RenderSettings = BEST
    sigma: float | None = 0.02
    flat = FLAT

    @abstractmethod
    def run(self, mosaic: Mosaic) -> FloatArray:
        """Return the stage's result for a mosaic: one array, rows and columns first; not flat by
        itself, flat for a flat scene.
        """

    def flat_scene(self, pattern: CfaPattern, shape: tuple[int, int]) -> Mosaic:
        """A surface of one colour, without noise."""
        colour = np.linspace(0.3, 0.9, len(pattern.channels))
        return observe(
            np.broadcast_to(colour, (*shape, len(colour))),
            pattern,
            gamma_of(pattern),
            self.sigma and 1e-4,
        )

    @every_case
    def test_a_flat_scene_stays_flat(self, pattern: CfaPattern, shape: tuple[int, int]) -> None:
        result = self.run(self.flat_scene(pattern, shape))
        spread = result.max(axis=(0, 1)) - result.min(axis=(0, 1))
        assert (spread <= self.flat * np.abs(result).max(axis=(0, 1))).all()

    @every_case
    def test_the_result_is_finite_and_the_input_stays(
        self, pattern: CfaPattern, shape: tuple[int, int]
    ) -> None:
        mosaic = shot(pattern, shape, self.sigma)
        before = mosaic.samples.copy()
        assert np.isfinite(self.run(mosaic)).all()
        assert np.array_equal(mosaic.samples, before)

    def test_threads_leave_no_trace(self, each_thread_count: Iterator[int]) -> None:
        mosaic = shot(CfaPattern.bayer(6, origin=(1, 2)), (151, 90), self.sigma)
        expected = self.run(mosaic)
        for _ in each_thread_count:
            assert np.array_equal(self.run(mosaic), expected)


class RowStageTests(StageTests):
    """Tests of a stage that sees the picture in rows.

    name: its name in `row_stages`.
    pattern: one with which `row_stages` has it.
    """

    name: str
    pattern = CfaPattern.bayer(6, origin=(1, 2))

    def stages(self, measured: Frame) -> list[RowStage]:
        """Return the stages as far as this one; all of them where a frame does not need it."""
        stages = row_stages(measured, self.settings)
        names = [stage.name for stage in stages]
        return stages[: names.index(self.name) + 1] if self.name in names else stages

    def run(self, mosaic: Mosaic) -> FloatArray:
        return self.rendered(mosaic, [0, mosaic.shape[0]])

    def rendered(self, mosaic: Mosaic, cuts: list[int]) -> FloatArray:
        """Return colour after the stage, (H, W, C), from bands that end at these rows."""
        measured = measure(mosaic, self.settings)
        grey = np.full(
            (*measured.shape, len(measured.gamma)), measured.mosaic.calibration.grey, np.float32
        )
        whole = Band(0, measured.luminance, grey)
        first, *others = self.stages(measured)
        assert isinstance(first, Propagation)
        spread = Band.joined(list(run_stages([whole], [first], measured.shape[0])))
        bands = [spread.rows(*rows) for rows in pairwise(cuts)]
        done = Band.joined(list(run_stages(bands, others, measured.shape[0])))
        return done.chromaticity * done.luminance[..., None]

    def test_bands_are_the_whole(self) -> None:
        mosaic = shot(self.pattern, (211, 60), self.sigma)
        assert self.name in [stage.name for stage in self.stages(measure(mosaic, self.settings))]
        expected = self.rendered(mosaic, [0, 211])
        for cuts in ([0, 1, 70, 71, 140, 211], [*range(0, 211, 13), 211]):
            assert np.array_equal(self.rendered(mosaic, cuts), expected)
