"""What `cadtof simulate` and `sweep` do."""
