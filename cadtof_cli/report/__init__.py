"""The HTML page of a run: one file, readable without a network, safe to open whatever names are in it."""
