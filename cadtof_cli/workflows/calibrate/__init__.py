"""What `cadtof calibrate` does."""
