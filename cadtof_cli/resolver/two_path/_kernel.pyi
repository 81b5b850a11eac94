"""Compiled from _kernel.c, whose METHODS say what each function takes; called through `kernel.extension`."""
