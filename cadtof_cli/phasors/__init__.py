"""Stored values → voltages → phasors: their scale, response and noise, and means of them."""
