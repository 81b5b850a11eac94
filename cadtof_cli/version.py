"""Which version of cadtof this is: what files that it writes say, as pyproject.toml has it."""

__version__ = "0.2.0.dev0"
