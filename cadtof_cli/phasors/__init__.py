"""Voltages → phasors: zero, scale, normalisation, response."""
