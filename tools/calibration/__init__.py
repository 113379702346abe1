"""What a camera is, out of its shots: gamma (Eq. 7), noise, black level, defects, colour; the file that keeps it, the report."""
