"""Errors in the words of a notebook: the libraries and commands below speak of options, such as --overwrite, and not of arguments.

Every option that a message can name here is an argument of the function that raises it, under the same name. Options have the right
types when a command sees them; arguments are checked here: overwrite="no" would replace a file, a limit in quotes blame the file.
"""

import re
from collections.abc import Callable
from functools import wraps
from inspect import signature
from numbers import Integral, Real
from os import PathLike
from reprlib import repr as shortened
from typing import ParamSpec, TypeVar

import numpy as np

from shared import CaptureMetadata, Mosaic, SensorCalibration
from shared.errors import InputError, PanchromaError
from tools.host.console import fault

P = ParamSpec("P")
R = TypeVar("R")

# The first that fits; patterns of `re`.
_ARGUMENTS = {
    r"--overwrite\b": "overwrite=True",
    r"render with --space camera\b": 'save with space="camera"',
    r"--space camera\b": 'space="camera"',
    r"--wb (camera|auto)\b": r'wb="\1"',
    r"panchroma simulate --pattern\b": "the argument pattern",
    r"simulate --max-pixels\b": "max_pixels",
    r"`?\bpanchroma (simulate|render)\b`?": r"panchroma.\1",
}
# An option, but not where it is that of a command for a terminal.
_OPTION = re.compile(r"(panchroma [a-z-]+ [^;:,()]*)|--([a-z]+(?:-[a-z]+)*)")
# Arguments of any function, what they are to be, and their types. True is no number, although Python takes it for 1.
_TYPES: tuple[tuple[tuple[str, ...], str, tuple[type, ...]], ...] = (
    (("path", "camera"), "the name of a file", (str, PathLike)),
    (("preset", "channels", "format", "space"), "a text", (str,)),
    (("bits", "seed", "scale", "quality", "max_pixels"), "a whole number", (Integral,)),
    (("sigma", "light", "exposure", "white"), "a number", (Real,)),
    (("shading", "aberration"), "two numbers", (tuple, list, np.ndarray)),
    (("linear", "learned", "overwrite"), "True or False", (bool, np.bool_)),
    (("mosaic",), "a shared.Mosaic; panchroma.simulate makes a shot of an array", (Mosaic,)),
    (("calibration",), "a shared.SensorCalibration", (SensorCalibration,)),
    (("metadata",), "a shared.CaptureMetadata", (CaptureMetadata,)),
)
_EXPECTED = {name: (what, types) for names, what, types in _TYPES for name in names}


def in_arguments(text: str) -> str:
    """A message about options as one about arguments.

    >>> in_arguments("x.png: exists already; use --overwrite to replace it")
    'x.png: exists already; use overwrite=True to replace it'
    >>> in_arguments("the limit is 9, --max-pixels raises it")
    'the limit is 9, max_pixels raises it'
    >>> in_arguments("measure it (panchroma calibrate --flat), or leave --camera out")
    'measure it (panchroma calibrate --flat), or leave camera out'
    """
    for option, argument in _ARGUMENTS.items():
        text = re.sub(option, argument, text)
    return _OPTION.sub(lambda found: found[1] or found[2].replace("-", "_"), text)


def check_argument(name: str, value: object) -> None:
    """Raise InputError for a value of another type than an argument of this name has.

    >>> check_argument("scale", 3)
    >>> check_argument("scale", "3")
    Traceback (most recent call last):
    shared.errors.InputError: scale is '3', expected a whole number
    """
    if name not in _EXPECTED:
        return
    what, types = _EXPECTED[name]
    fits = isinstance(value, types) and (bool in types or not isinstance(value, bool))
    if not fits or (isinstance(value, str) and not value):
        raise InputError(f"{name} is {shortened(value)}, expected {what}")


def for_notebooks(function: Callable[P, R]) -> Callable[P, R]:
    """The function, whose errors speak of arguments, and of what to install where a package is missing."""
    parameters = signature(function).parameters

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        for name, value in (*zip(parameters, arguments, strict=False), *named.items()):
            if name in parameters and not (value is None and parameters[name].default is None):
                check_argument(name, value)
        try:
            return function(*arguments, **named)
        except PanchromaError as error:
            raise type(error)(in_arguments(str(error))) from None
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(fault(error), name=error.name) from None

    return call
