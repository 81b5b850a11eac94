"""Stored values → voltages → phasors: whether they can be a recording, their scale, response, noise, and means."""
