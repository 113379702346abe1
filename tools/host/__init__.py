"""The machine and the person at it: terminal, signals, memory, processes. Knows nothing of pictures, scenes or shots."""
