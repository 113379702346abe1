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

from .options import add, names_pattern, pattern_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `panchroma export-preview`."""
    parser.add_argument("-o", "--output", required=True, metavar="FILE", help="ends in .onnx")
    pattern = parser.add_argument_group("the pattern")
    add(pattern, "pattern", "period")
    pattern.add_argument("--like", metavar="SHOT", help="use the pattern of this shot")
    add(parser, "scale", default=1)
    parser.add_argument(
        "--space", choices=("srgb", "camera"), default="srgb", help="srgb: a picture for a screen; camera: camera RGB, scene units"
    )
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
    if names_pattern(arguments):
        raise InputError("--like takes the pattern of a shot; leave --pattern and --period out")
    return read_dng(arguments.like).pattern
