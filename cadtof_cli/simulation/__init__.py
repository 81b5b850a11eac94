"""The pixel, its statistics, and whole scenes."""
