"""OpenCV's chart detector (`cv2.mcc`) and image filters; the calls of the detector differ between OpenCV 4.10 and 5."""

from typing import Any

import numpy as np

from shared.arrays import ByteArray, DoubleArray
from shared.errors import InputError

# The detector's box lies half a gap outside the patches, in cells: its model has patches of 2.5 every 2.75 units.
BOX_MARGIN = 0.125 / 2.75
_CLASSIC = 0  # cv2.mcc.MCC24, in every version


def detect(picture: ByteArray, most: int) -> list[DoubleArray]:
    """Return the boxes of up to `most` possible ColorChecker Classics, the likeliest first: corners (4, 2), x and y.

    picture: (H, W, 3), uint8 RGB.
    most: number of boxes.

    The corners are those at dark skin, bluish green, black and white, if the detector is right. Raises InputError if OpenCV is
    missing or was built without `mcc`.
    """
    try:
        import cv2
    except ImportError:
        raise InputError("finding a chart needs OpenCV: pip install 'opencv-contrib-python-headless>=4.10'") from None
    module: Any = getattr(cv2, "mcc", None)
    if module is None:
        raise InputError(
            "this OpenCV has no chart detector (cv2.mcc): remove opencv-python, "
            "then pip install --force-reinstall 'opencv-contrib-python-headless>=4.10'"
        )
    detector = module.CCheckerDetector.create()
    blue_first = np.ascontiguousarray(picture[..., ::-1])
    cv2.setRNGSeed(0)  # the detector draws random numbers
    try:
        if hasattr(detector, "setColorChartType"):  # OpenCV 5: chart and parameters are properties, MCC24 the default
            detector.setDetectionParams(_eager(module.DetectorParametersMCC()))
            found = detector.process(blue_first, most)
        else:
            found = detector.process(blue_first, _CLASSIC, most, False, _eager(module.DetectorParameters.create()))
    except cv2.error:  # some textures make it fail (an empty contour, a singular homography): nothing was found
        return []
    if not found:
        return []
    charts = sorted(detector.getListColorChecker(), key=lambda chart: float(chart.getCost()))
    boxes = [np.array(chart.getBox(), np.float64).reshape(4, 2) for chart in charts]
    return [box for box in boxes if np.isfinite(box).all()]


def _eager(parameters: Any) -> Any:
    """Set parameters for more proposals and smaller charts: all proposals are checked later."""
    parameters.confidenceThreshold = 0.1
    parameters.minInterContourDistance = 20
    return parameters


def resized(picture: ByteArray, scale: float) -> ByteArray:
    """Return the picture `scale` times as large: averaged if smaller, bicubic if larger."""
    import cv2

    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=method), np.uint8)


def median_filtered(picture: ByteArray) -> ByteArray:
    """Return the 5 x 5 median of a picture, which removes the false colours of sparse samples at edges."""
    import cv2

    return np.asarray(cv2.medianBlur(picture, 5), np.uint8)
