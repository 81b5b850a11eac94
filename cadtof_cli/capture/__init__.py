"""Captures: their metadata, and where their frames lie in folders and files."""
