"""Paths → depth maps, and how maps differ from truth and from each other."""
