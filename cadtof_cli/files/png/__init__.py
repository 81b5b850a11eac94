"""PNG files: a plane each."""
