"""The Python door: what `from cadtof_cli import …` offers. Thin: the work is that of the commands, by the same functions."""
