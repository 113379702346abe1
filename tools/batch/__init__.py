"""Many shots: jobs, folders, journals, memory, processes; the terminal and its signals."""
