"""Tasks → results on one core or many processes; no domain code."""
