"""The machine and the person at it: terminal, signals, memory, processes. Uses no other room of `tools`."""
