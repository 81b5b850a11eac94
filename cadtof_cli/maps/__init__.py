"""Paths → depth maps; how maps differ from truth and from each other."""
