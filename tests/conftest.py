"""For all tests: signals do what they do in a terminal.

A shell that runs the tests in the background has them ignore SIGINT, nohup SIGHUP, and their children too.
"""

import signal

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
