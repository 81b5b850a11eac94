"""Depth maps free of multi-path interference from CA-dToF cameras."""

__version__ = "0.1.0"
