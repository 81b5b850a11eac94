"""Two paths from harmonics 1 and 2 in closed form, one path, and their uncertainty."""
