"""Paths → depth maps; EXR and TIFF writers."""
