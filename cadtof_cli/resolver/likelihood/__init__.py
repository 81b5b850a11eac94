"""Maximum likelihood for more than two harmonics or more than two paths."""
