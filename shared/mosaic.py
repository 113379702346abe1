"""The mosaic: what the sensor measured, with everything needed to make sense of it."""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from .arrays import CACHED, STRIP, CodeArray, FloatArray, is_frozen, strips, unmasked
from .calibration import SensorCalibration
from .errors import InputError
from .metadata import CaptureMetadata
from .pattern import CfaPattern


@dataclass(frozen=True, eq=False)
class Mosaic:
    """One frame of samples (H, W) with pattern, calibration and capture data, checked once, here.

    Attributes
    ----------
    samples : CodeArray | FloatArray
        uint16 sensor codes, or floating point in scene units (linear, black subtracted, shading
        undone; noise may make it negative, and 1.0 is the scene's white). Kept read-only: as a
        copy, unless the array is float32, read-only and owns its memory, or uint16 in whole rows
        and nobody can write to it (`is_frozen`): a camera has no time for a copy.

    Raises
    ------
    InputError
        When the samples are not a finite (H, W) array of those types, hold no whole colour block,
        use codes beyond the calibration's bits, when pattern and calibration name different
        channels, and when shading was measured on frames of another shape.

    Examples
    --------
    >>> import numpy as np
    >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
    >>> codes = np.full((12, 18), 3839, np.uint16)  # every pixel at the white level of 12 bits
    >>> mosaic = Mosaic(codes, CfaPattern.bayer(6), SensorCalibration.of_bits(12))
    >>> mosaic.shape, float(mosaic.signal[5, 5])  # scene units
    ((12, 18), 3.0)
    """

    samples: CodeArray | FloatArray
    pattern: CfaPattern
    calibration: SensorCalibration
    metadata: CaptureMetadata = field(default_factory=CaptureMetadata)

    def __post_init__(self) -> None:
        samples = unmasked(self.samples)
        samples = samples.astype(samples.dtype.newbyteorder("="), copy=False)
        if samples.ndim != 2:
            found = f"the samples have shape {samples.shape}"
            raise InputError(f"a mosaic has two axes (rows, columns); {found}")
        self.pattern.grid((samples.shape[0], samples.shape[1]))
        self._check_calibration((samples.shape[0], samples.shape[1]))
        if samples.dtype == np.uint16:
            frozen = is_frozen(samples) and samples.strides[1] == samples.itemsize
            kept = samples if frozen else np.array(samples, order="C")
            if int(kept.max()) >> self.calibration.bits:
                most = f"more than the calibration's {self.calibration.bits} bits hold"
                raise InputError(f"a sample is {kept.max()}, {most}")
        elif np.issubdtype(samples.dtype, np.floating):
            flags, is_single = samples.flags, samples.dtype == np.float32
            frozen = is_single and flags.owndata and flags.c_contiguous and not flags.writeable
            kept = samples if frozen else np.array(samples, np.float32, order="C")
            # A NaN is the largest and the smallest of all.
            if not np.isfinite([kept.min(), kept.max()]).all():
                bad = int((~np.isfinite(kept)).sum())
                raise InputError(f"{bad} of {kept.size} samples are not finite (NaN or infinite)")
        else:
            expected = "expected uint16 codes or floating-point scene units"
            raise InputError(f"samples are {samples.dtype}, {expected}")
        kept.flags.writeable = False
        object.__setattr__(self, "samples", kept)

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.samples.shape[0], self.samples.shape[1]

    @property
    def signal(self) -> FloatArray:
        """m[n] in scene units, float32 (H, W): black subtracted, `calibration.full_scale` at the
        white level, shading undone.

        Computed from sensor codes on every access: keep it in a variable, or use `in_scene_units`.
        """
        if self.samples.dtype == np.float32:
            return self.samples  # type: ignore[return-value]
        # There are few codes: look their values up. Double precision then costs nothing, and white
        # reads exactly full scale.
        every = np.arange(1 << self.calibration.bits)[:, None]
        levels = (every - self.calibration.black_level) * self.calibration.scale()
        values = np.ascontiguousarray(levels.T, np.float32)
        shading = self.calibration.shading
        codes, signal = self.codes, np.empty(self.shape, np.float32)
        # The look-up takes eight bytes per pixel.
        for plane, *lattice in self._lattices(max(1, CACHED // self.shape[1])):
            # "clip": no code is out of range
            values[plane].take(codes[*lattice], out=signal[*lattice], mode="clip")
            if shading:
                signal[*lattice] *= shading.of_plane(self.shape, plane, *lattice)
        signal.flags.writeable = False
        return signal

    @property
    def codes(self) -> CodeArray:
        """Sensor codes, uint16 (H, W): the samples themselves, or scene units quantised and clipped
        to the code range.

        Computed from scene units on every access: keep it in a variable.
        """
        if self.samples.dtype == np.uint16:
            return self.samples  # type: ignore[return-value]
        codes = np.empty(self.shape, np.uint16)
        for plane, *lattice in self._lattices(STRIP):
            codes[*lattice] = self._quantised(plane, *lattice)
        codes.flags.writeable = False
        return codes

    def calibrated(self, calibration: SensorCalibration) -> "Mosaic":
        """Return these samples with another calibration; of as many bits they need not be checked
        again.

        Raises InputError.
        """
        if calibration.bits != self.calibration.bits:
            return replace(self, calibration=calibration)
        result = copy(self)
        object.__setattr__(result, "calibration", calibration)
        result._check_calibration(self.shape)
        return result

    def in_scene_units(self) -> "Mosaic":
        """Return the mosaic with float32 samples in scene units; the mosaic itself if it has them
        already.
        """
        return self if self.samples.dtype == np.float32 else replace(self, samples=self.signal)

    def evenly_shaded(self) -> "Mosaic":
        """The mosaic in scene units as if all planes had the shading of the panchromatic one;
        without shading `in_scene_units`.

        Such a frame is an ordinary one of a darker scene: Eq. 7 holds, panchromatic samples have
        the calibration's noise and reach full scale where they saturate. Its calibration has no
        shading. Light times the panchromatic gain is that of the scene.

        Examples
        --------
        >>> import numpy as np
        >>> from panchroma.shared import CfaPattern, Mosaic, SensorCalibration
        >>> mosaic = Mosaic(np.full((12, 18), 3839, np.uint16), CfaPattern.bayer(6),
        ...     SensorCalibration.of_bits(12))
        >>> float(mosaic.evenly_shaded().signal[5, 5])
        3.0
        """
        shading = self.calibration.shading
        if shading is None:
            return self.in_scene_units()
        bare = replace(self, calibration=replace(self.calibration, shading=None))
        signal = bare.signal.copy()
        if self.samples.dtype == np.float32:
            for rows in strips(self.shape[0]):
                signal[rows] /= shading.of_plane(self.shape, -1, rows)
        else:
            for channel, *lattice in self.pattern.lattices:
                ours = shading.of_plane(self.shape, channel, *lattice)
                signal[*lattice] *= ours / shading.of_plane(self.shape, -1, *lattice)
        signal.flags.writeable = False
        return replace(bare, samples=signal)

    def _lattices(self, height: int) -> Iterator[tuple[int, slice, slice]]:
        """Yield (plane, rows, columns): strips of so many rows as if all their pixels were
        panchromatic, then the sites of the channels.
        """
        yield from ((-1, rows, slice(None)) for rows in strips(self.shape[0], height))
        yield from self.pattern.lattices

    def _check_calibration(self, shape: tuple[int, int]) -> None:
        """Raise InputError unless the calibration is for this pattern and for frames of this
        shape.
        """
        self.calibration.check_pattern(self.pattern)
        if self.calibration.shading is not None:
            self.calibration.shading.check(shape)

    def _quantised(self, plane: int, rows: slice, columns: slice) -> FloatArray:
        """Samples of one plane in scene units -> whole codes. Single precision is off by less than
        a hundredth of a 16-bit code.
        """
        calibration = self.calibration
        per_unit = np.float32(1 / calibration.scale()[plane])
        with np.errstate(over="ignore"):  # what overflows is clipped to the highest code anyway
            codes: FloatArray = self.samples[rows, columns] * per_unit
        if calibration.shading is not None:
            codes /= calibration.shading.of_plane(self.shape, plane, rows, columns)
        codes += np.float32(calibration.black_level[plane])
        return np.rint(codes, out=codes).clip(0, (1 << calibration.bits) - 1, out=codes)
