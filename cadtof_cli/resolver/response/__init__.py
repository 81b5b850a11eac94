"""Paths for channel pairs whose response is no pure sine."""
