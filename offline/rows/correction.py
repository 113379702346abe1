"""What the finished picture misses at the colour sites, and its correction (see `offline.sites`)."""

from dataclasses import dataclass, replace

import numpy as np

from shared.arrays import FloatArray

from ..kernels.pieces import copied, in_pieces
from ..measured import BlockSamples
from ..parts import DARK, Look, Part, RowStage
from ..sites import most_probable, site_reach


@dataclass(eq=False)
class Missed(RowStage):
    """Measure what the picture misses at the colour sites (`Part.missed`). gamma: (C,), the weights of Eq. 7."""

    samples: BlockSamples
    gamma: FloatArray

    name = "missed"

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, with what they miss."""
        shown, sites = part.rows(*rows), self.samples.sites
        missed = np.zeros(shown.luminance.shape, np.float32)

        def measure(site: int) -> None:
            channel, (down, across) = sites.channels[site], sites.places[site]
            first, end = (max(-(-(row - down.start) // down.step), 0) for row in rows)  # rows of blocks
            end, top = min(end, sites.shape[0]), down.start + first * down.step - rows[0]
            if end <= first:
                return
            place = slice(top, top + (end - first - 1) * down.step + 1, down.step), across
            seen = shown.chromaticity[place][..., channel] * shown.luminance[place]
            error = (self.samples.samples[first:end, :, site] - seen) * self.gamma[channel]
            missed[place] = error * self.samples.unclipped[first:end]

        in_pieces(lambda site, _: measure(site), len(sites.places))
        return replace(shown, missed=missed)


@dataclass(eq=False)
class Correction(RowStage):
    """Share out what the picture misses at the colour sites of a block to all channels of all of them."""

    samples: BlockSamples
    gamma: FloatArray

    name = "correction"
    kernels = "share_out", "smooth"

    @property
    def look(self) -> Look:
        """The blocks around a site."""
        return Look(site_reach(self.samples.sites.grid.period))

    def memory(self, pixels: int, channels: int) -> float:
        """Bytes for this many pixels."""
        return 4.0 * (2 + channels) * pixels

    def __call__(self, part: Part, rows: tuple[int, int]) -> Part:
        """These rows, corrected."""
        return correct_sites(part, self.samples, self.gamma).rows(*rows)


def correct_sites(part: Part, measured: BlockSamples, gamma: FloatArray) -> Part:
    """A part of a picture with the errors at its colour sites shared out; only rows `site_reach` inside the part are final.

    part: with what it misses. gamma: (C,), the weights of Eq. 7.
    """
    rows = measured.within(part)
    if rows.start >= rows.stop:
        return part
    places, channels = measured.inside(part, rows), measured.sites.channels
    colour = np.empty((rows.stop - rows.start, measured.sites.shape[1], len(places)), np.float32)

    def look(site: int) -> None:
        np.multiply(part.chromaticity[places[site]][..., channels[site]], gamma[channels[site]], out=colour[..., site])

    in_pieces(lambda site, _: look(site), len(places))
    light, tints = most_probable(measured.missed(part, rows), colour, measured, rows, gamma)
    if measured.kept is not None:
        tints *= measured.kept[rows, :, None, None]
    luminance, chromaticity = copied(part.luminance), copied(part.chromaticity)

    def correct(site: int) -> None:
        place = places[site]
        before = luminance[place]
        after = before + light[..., site]
        lit = ~((after <= DARK) | (before <= DARK))[..., None]  # what is not a number is to be seen, and refused
        # Colour that luminance gains has the chromaticity that was there; tints leave luminance as it is.
        tinted = chromaticity[place] + tints[:, :, site] / (gamma * np.where(lit, after[..., None], 1))
        luminance[place] = np.where(lit[..., 0], after, before)
        chromaticity[place] = np.where(lit, tinted, chromaticity[place])

    in_pieces(lambda site, _: correct(site), len(places))
    return replace(part, luminance=luminance, chromaticity=chromaticity)
