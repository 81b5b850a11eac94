"""Measure the limits of the resolver: the pages of docs/limits, made by scripts/measure_limits."""
