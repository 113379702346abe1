"""The options that say which filter pattern a sensor has, for every command that meets a sensor."""

import argparse

from shared import CfaPattern
from shared.pattern import BAYER_ORDERS, PERIODS

_PERIOD, _ORDER, _ORIGIN = 6, "RGGB", (0, 0)


def add_pattern_options(group: argparse._ActionsContainer) -> None:
    """--period, --order and --origin; `pattern_of` makes the pattern of them."""
    periods = f"{PERIODS[0]} to {PERIODS[-1]}"
    group.add_argument("--period", type=int, metavar="K", help=f"pixels from block to block, {periods} (default: {_PERIOD})")
    group.add_argument("--order", choices=BAYER_ORDERS, help=f"filters of a block (default: {_ORDER})")
    group.add_argument("--origin", type=int, nargs=2, metavar=("ROW", "COLUMN"), help="where the first block is (default: 0 0)")


def pattern_of(arguments: argparse.Namespace, known: CfaPattern | None = None) -> CfaPattern:
    """The pattern that was asked for; where nothing was, the one that is `known` of the camera.

    Raises InputError for a period that no pattern has.
    """
    if known is not None and arguments.period is arguments.order is arguments.origin is None:
        return known
    period = _PERIOD if arguments.period is None else arguments.period
    return CfaPattern.bayer(period, arguments.order or _ORDER, tuple(arguments.origin or _ORIGIN))
