"""For all tests: SIGINT interrupts.

A shell that runs the tests in the background has them ignore it, and their children too.
"""

import signal

signal.signal(signal.SIGINT, signal.default_int_handler)
