"""Compiled from _kernel.c, whose METHODS list the arguments of each function; called through `kernels.extension`."""
