"""Eq. (9), the paper's own method."""
