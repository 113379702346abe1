"""Shots to pictures: one, or a million. What is made already, what is still to do, by how many processes, on how many machines."""
