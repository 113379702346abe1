"""Errors in the words of a notebook: the libraries and commands below speak of options, such as --overwrite, and not of arguments.

Every option that a message can name here is an argument of the function that raises it, under the same name.
"""

import re
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from shared.errors import PanchromaError
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
_OPTION = re.compile(r"--([a-z]+(?:-[a-z]+)*)")


def in_arguments(text: str) -> str:
    """A message about options as one about arguments.

    >>> in_arguments("x.png: exists already; use --overwrite to replace it")
    'x.png: exists already; use overwrite=True to replace it'
    >>> in_arguments("the limit is 9, --max-pixels raises it")
    'the limit is 9, max_pixels raises it'
    """
    for option, argument in _ARGUMENTS.items():
        text = re.sub(option, argument, text)
    return _OPTION.sub(lambda found: found[1].replace("-", "_"), text)


def for_notebooks(function: Callable[P, R]) -> Callable[P, R]:
    """The function, whose errors speak of arguments, and of what to install where a package is missing."""

    @wraps(function)
    def call(*arguments: P.args, **named: P.kwargs) -> R:
        try:
            return function(*arguments, **named)
        except PanchromaError as error:
            raise type(error)(in_arguments(str(error))) from None
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(fault(error), name=error.name) from None

    return call
