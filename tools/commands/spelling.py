"""Messages of the library in the words of the command line.

The library marks the names of arguments, with or without a value: `sigma`, `overwrite=True`.
"""

import re
from collections.abc import Collection

_OPTIONS = {"width": "size", "height": "size"}  # where names differ
_SIZE = {"width": "{}xHEIGHT", "height": "WIDTHx{}"}
_WORDS = {"max_pixels": "the environment variable PANCHROMA_MAX_PIXELS"}
_ARGUMENT = re.compile(r"`([a-z_]+)(?:=([^`]*))?`")


def option_of(argument: str) -> str:
    """Return the option that sets an argument of the library, whichever verb has it."""
    return f"--{_OPTIONS.get(argument, argument).replace('_', '-')}"


def spelled(message: str, options: Collection[str]) -> str:
    """Return a message with options in place of the arguments that it names.

    An argument that is none of these options, those of a verb, becomes plain words.

    Examples
    --------
    >>> spelled("exists already; use `overwrite=True` to replace it", ["--overwrite"])
    'exists already; use --overwrite to replace it'
    """

    def option(match: re.Match[str]) -> str:
        name, value = match[1], match[2] or ""
        if name in _WORDS:
            return _WORDS[name]
        value = _SIZE.get(name, "{}").format(value.strip('"')) if value not in ("", "True") else ""
        known = option_of(name)
        return f"{known if known in options else name.replace('_', ' ')} {value}".rstrip()

    if "--overwrite" not in options:
        message = message.replace("use `overwrite=True` to replace it", "choose another folder")
    return _ARGUMENT.sub(option, re.sub("`width`(,| and| or) `height`", "`size`", message))
