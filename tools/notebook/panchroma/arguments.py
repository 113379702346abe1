"""Arguments are checked when a function is called: overwrite="no" would replace a file, a limit in quotes blame the file."""

from collections.abc import Callable
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from os import PathLike
from reprlib import repr as shortened
from typing import ParamSpec, TypeVar

import numpy as np

from shared import CaptureMetadata, Mosaic, SensorCalibration
from shared.errors import InputError
from tools.batch.in_memory import missing_package

P = ParamSpec("P")
R = TypeVar("R")

# Arguments of any function, what they are to be, and their types. True is no number, although Python takes it for 1.
_TYPES: tuple[tuple[tuple[str, ...], str, tuple[type, ...]], ...] = (
    (("path", "camera"), "the name of a file", (str, PathLike)),
    (("channels", "format", "space"), "a text", (str,)),
    (("bits", "seed", "scale", "quality", "max_pixels"), "a whole number", (Integral,)),
    (("sigma", "light", "exposure", "white"), "a number", (Real,)),
    (("shading",), "two numbers", (tuple, list, np.ndarray)),
    (("linear", "overwrite"), "True or False", (bool, np.bool_)),
    (("mosaic",), "a shared.Mosaic; panchroma.simulate makes a shot of an array", (Mosaic,)),
    (("calibration",), "a shared.SensorCalibration", (SensorCalibration,)),
    (("metadata",), "a shared.CaptureMetadata", (CaptureMetadata,)),
)
_EXPECTED = {name: (what, types) for names, what, types in _TYPES for name in names}


def check_argument(name: str, value: object) -> None:
    """Raise InputError for a value of another type than an argument of this name has.

    >>> check_argument("scale", 3)
    >>> check_argument("scale", "3")
    Traceback (most recent call last):
    shared.errors.InputError: `scale` is '3', expected a whole number
    """
    if name not in _EXPECTED:
        return
    what, types = _EXPECTED[name]
    fits = isinstance(value, types) and (bool in types or not isinstance(value, bool))
    if not fits or (isinstance(value, str) and not value):
        raise InputError(f"`{name}` is {shortened(value)}, expected {what}")


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, whose arguments are checked, and whose errors say what to install where a package is missing."""
    parameters = signature(function).parameters

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        for name, value in (*zip(parameters, arguments, strict=False), *named.items()):
            if name in parameters and not (value is None and parameters[name].default is None):
                check_argument(name, value)
        try:
            return function(*arguments, **named)
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(missing_package(error), name=error.name) from None

    return call
