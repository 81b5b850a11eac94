"""Rooms whose surfaces light each other: what stands in them, how light is traced, and how a camera sees it."""
