"""One frame: voltages → maps. Pure: arrays and records in, arrays and records out."""
