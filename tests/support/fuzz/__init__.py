"""Hostile input: sound samples of everything that is read, ways to spoil them, and the readers."""
