"""Eq. (9), the method of the paper."""
