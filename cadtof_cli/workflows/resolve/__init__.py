"""What `cadtof resolve` does."""
