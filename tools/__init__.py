"""The command line, and what its verbs do; only this package starts programs."""

import sys

try:
    import fcntl as fcntl
except ModuleNotFoundError:
    sys.exit(
        "panchroma: it runs on Linux and macOS; on Windows install it in the Windows Subsystem "
        "for Linux (WSL)"
    )
