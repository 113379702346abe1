"""Shots to pictures: one, or a million, by several processes or machines, with a record of what is done."""
