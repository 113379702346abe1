"""Speed and memory: what `panchroma bench` measures, and how."""
