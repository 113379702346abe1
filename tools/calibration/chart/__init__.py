"""Find a ColorChecker in a shot and read its patches."""
