"""How fast everything is: what `panchroma bench` measures, and how."""
