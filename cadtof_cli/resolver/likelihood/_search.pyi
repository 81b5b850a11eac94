"""Compiled from _search.c, whose METHODS say what each function takes; called through `compiled.compiled_search`."""
