"""What the resolver cannot know, measured: the pages of docs/limits, made by scripts/measure_limits."""
