"""What `cadtof info`, `evaluate` and `preview` do."""
