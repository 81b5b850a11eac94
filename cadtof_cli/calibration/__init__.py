"""Dark, response and Petzval calibration: fit, apply, its exact inverse, store."""
