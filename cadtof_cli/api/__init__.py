"""The Python interface, `from cadtof_cli import …`. It is thin: the functions that do the work are those of the commands."""
