"""Maximum likelihood for more harmonics and more paths."""
