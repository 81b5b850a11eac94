"""Stored values and maps → what is likely wrong with a recording, in words. Nothing that computes depths depends on it."""
