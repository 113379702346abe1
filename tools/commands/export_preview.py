"""Write the graph that makes a camera's previews as an ONNX file, for another runtime than Panchroma's own.

device/preview/contract.py describes its inputs and outputs. One file serves all cameras with this pattern, at any origin.
"""

import argparse
from pathlib import Path

from shared import CfaPattern, read_dng
from shared.errors import InputError
from shared.writing import write_durably
from tools.host.console import Console
from tools.pictures.previews import preview_graph

from .options import add, file_name, option, pattern_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma export-preview`."""
    option(parser, "-o --output FILE", "ends in .onnx", required=True)
    pattern = parser.add_argument_group("the pattern")
    add(pattern, "pattern", "period")
    option(pattern, "--like SHOT", "use the pattern of this shot", type=file_name)
    add(parser, "scale", default=1)
    spaces = "srgb: a picture for a screen; camera: camera RGB, scene units"
    option(parser, "--space", spaces, choices=("srgb", "camera"), default="srgb")
    add(parser, "overwrite")


def run(arguments: argparse.Namespace, console: Console) -> int:
    """Write the graph; returns the exit code."""
    path = Path(arguments.output)
    if path.suffix != ".onnx":
        raise InputError(f"{arguments.output}: a graph has a name that ends in .onnx; write {path.stem}.onnx")
    graph = preview_graph(_pattern(arguments), arguments.scale, linear=arguments.space == "camera")
    write_durably(path, graph, overwrite=arguments.overwrite)
    console.say(f"{path}: {len(graph)} bytes")
    return 0


def _pattern(arguments: argparse.Namespace) -> CfaPattern:
    if not arguments.like:
        return pattern_of(arguments)
    if arguments.pattern is not None or arguments.period is not None:
        raise InputError("--like takes the pattern of a shot; leave --pattern and --period out")
    return read_dng(arguments.like).pattern
