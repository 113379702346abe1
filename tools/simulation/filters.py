"""The filters of a simulated sensor: how each is made from the channels of a scene, and what they
add up to without a filter.

Every filter is scaled so that it reads 1 where the scene is white. A panchromatic pixel collects
the light of all channels, so it reads the more, the less of them the filters let through: R + G + B
= 3 in white beside red, green and blue, but (C + M + Y) / 2 = 1.5 beside cyan, magenta and yellow,
which collect two channels each. The scene units of two cameras thus differ: `Filters.unit`.
"""

from typing import NamedTuple

import numpy as np

from ...shared import CfaPattern, FloatArray, InputError
from ...shared.colorimetry import Matrix, as_rows, nominal_to_xyz
from ..io.scene import BROADBAND, RGB, Scene

_DIGITS = 12  # of gamma: the last bits of a least-squares solution depend on the processor
_ROUNDING = 1e-6  # smaller weights and differences are rounding


class Filters(NamedTuple):
    """The filters of a sensor, each a mixture of the channels of a scene. `filters_for` makes them.

    Attributes
    ----------
    channels : str
        The letters of the filters, in the order of the pattern.
    matrix : Matrix
        (C, N), from the scene's channels to the filters' readings; each row adds up to 1.
    gamma : tuple[float, ...]
        (C,), positive weights of Eq. 7.

    Examples
    --------
    >>> import numpy as np
    >>> scene = Scene(np.float32([[[0.2, 0.4, 0.8]]]), "leaf")
    >>> filters = filters_for(CfaPattern.with_block(("CM", "YC"), period=6), scene)
    >>> filters.channels, filters.gamma, filters.of(scene.rgb).round(3).tolist()
    ('CMY', (0.5, 0.5, 0.5), [[[0.6..., 0.5, 0.3...]]])
    """

    channels: str
    matrix: Matrix
    gamma: tuple[float, ...]

    @property
    def unit(self) -> float:
        """Scene units of this sensor that are one of a sensor with red, green and blue filters,
        under the same light.
        """
        return sum(self.gamma) / 3

    def of(self, light: FloatArray) -> FloatArray:
        """Readings through the filters: float32 (H, W, N) scene units -> (H, W, C). The same array
        if they are the scene's channels.
        """
        if np.array_equal(self.matrix, np.eye(light.shape[2])):
            return light
        read: FloatArray = np.zeros((*light.shape[:2], len(self.matrix)), np.float32)
        for filtered, weights in enumerate(self.matrix):
            for channel, weight in enumerate(weights):
                if weight:
                    read[..., filtered] += np.float32(weight) * light[..., channel]
        return read

    def colours(self, scene: Scene) -> tuple[Matrix | None, tuple[float, ...] | None]:
        """The scene's camera_to_xyz and neutral for these filters; the matrix is None if they do
        not tell three colours apart.

        If the scene knows no matrix, mixtures of its red, green and blue have that of sRGB
        primaries, as `ColourTransform` assumes.
        """
        matrix, to_xyz, neutral = np.array(self.matrix), scene.camera_to_xyz, scene.neutral
        if np.array_equal(matrix, np.eye(len(scene.channels))):
            return to_xyz, neutral
        white = None if neutral is None else tuple((matrix @ neutral).tolist())
        if to_xyz is not None:
            of_scene = np.array(to_xyz)
        elif set(RGB) <= set(scene.channels):
            of_scene = nominal_to_xyz(scene.channels, neutral)
        else:
            return None, white
        # Eq. 17 gives the filters' readings; the pseudo-inverse takes them back to the scene's
        # channels.
        of_filters = of_scene @ np.linalg.pinv(matrix)
        return (as_rows(of_filters) if np.linalg.matrix_rank(of_filters) == 3 else None), white


def filters_for(pattern: CfaPattern, scene: Scene) -> Filters:
    """The filters of a pattern before a scene: the scene's own channels, and C, M and Y made from
    R, G and B.

    Raises InputError for letters that are neither, and when no positive weights of the filters add
    up to what panchromatic pixels see.
    """
    channels, there = pattern.channels, scene.channels
    sources = dict(zip(there, np.eye(len(there)), strict=True))
    if set(RGB) <= set(there):
        for letter, mixture in BROADBAND.items():
            sources.setdefault(letter, np.sum([sources[each] for each in mixture], axis=0))
    if missing := [letter for letter in channels if letter not in sources]:
        both = f"the filters {_listed(missing)}, and the scene only {_listed(there)}"
        remedy = "use a scene with these channels, or another pattern"
        raise InputError(f"the pattern has {both}; {remedy}")
    passed = np.array([sources[channel] for channel in channels])
    matrix = passed / passed.sum(axis=1, keepdims=True)
    # The least-squares solution of "weighted filters add up to all channels".
    weights = np.linalg.lstsq(matrix.T, np.ones(len(there)))[0]
    if weights.min() < _ROUNDING:
        nearest = ", ".join(map("{} {:.3g}".format, channels, weights.round(3) + 0.0))
        needed = f"positive weights of {_listed(channels)} that add up to it"
        fault = f"panchromatic pixels see {' + '.join(there)}, and Eq. 7 needs {needed}"
        raise InputError(f"{fault}; there are none (the nearest: {nearest}), choose other filters")
    gamma = (weights / passed.sum(axis=1).mean()).round(_DIGITS)
    return Filters(channels, as_rows(matrix), tuple(gamma.tolist()))


def _listed(letters: str | list[str]) -> str:
    """The letters as a list in a sentence.

    Examples
    --------
    >>> _listed("RGB")
    'R, G and B'
    """
    return " and ".join(filter(None, (", ".join(letters[:-1]), letters[-1])))
