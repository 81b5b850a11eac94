"""Paths of channel pairs that answer with more than a sine."""
