"""What lateral chromatic aberration changes in the samples of a picture."""

from .arrays import Bytes2, Doubles2, Floats1, Floats2, Floats3
from .compile import Pieces, parallel_kernel
from .interpolation import interpolated


@parallel_kernel()
def undo_aberration(
    pieces: Pieces,
    picture: Floats3,
    first: int,
    height: int,
    radial: Doubles2,
    gamma: Floats1,
    planes: Bytes2,
    start: int,
    samples: Floats2,
) -> None:
    """Add to samples how much more they would read if the lens displaced no channel.

    picture: float32 (rows, W, C), what the lens saw: the rows of `samples`, and around them those that it displaces there, and two.
    first: the frame's row that is the picture's first.
    height: rows of the frame.
    radial: (C, 2), see `shared.Aberration`.
    gamma: (C,), weights of Eq. 7.
    planes: (K, K), the first pixels of the frame, which repeat: index of the channel, C for panchromatic.
    start: the frame's row that is the first of `samples`.
    samples: float32 (rows, W), changed in place.
    """
    channels, width = picture.shape[2], picture.shape[1]
    middle_y, middle_x = 0.5 * (height - 1), 0.5 * (width - 1)
    squared = middle_y * middle_y + middle_x * middle_x  # half the diagonal, squared
    for row in range(pieces[0], pieces[1]):
        y = start + row
        down = y - middle_y
        filters = planes[y % len(planes)]
        for x in range(width):
            along = x - middle_x
            square = (down * down + along * along) / squared
            plane = filters[x % len(filters)]
            for channel in range(channels):
                if plane not in (channel, channels):
                    continue
                further = radial[channel, 0] + radial[channel, 1] * square
                if further == 0:
                    continue
                there = interpolated(picture[:, :, channel], y - first + down * further, x + along * further)
                change = picture[y - first, x, channel] - there
                samples[row, x] += change if plane == channel else gamma[channel] * change
