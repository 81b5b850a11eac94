"""Compiled from _likelihood.c, whose METHODS list the arguments of each function; see `compiled.compiled_search`."""
