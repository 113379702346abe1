"""The ColorChecker in a shot: find it, check it, and say where its patches are."""
