"""Recorded frames of known targets → the numbers of a calibration."""
