"""The Python interface, `from cadtof_cli import …`: thin, since the same functions do the work as for the commands."""
