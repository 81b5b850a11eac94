"""The pixel: photons, averaging, statistics, bounds."""
