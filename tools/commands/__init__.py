"""The verbs of the command line: each module parses its options, calls one function of a room, and
writes what comes back.
"""
