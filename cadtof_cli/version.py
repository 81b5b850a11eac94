"""The version of cadtof, the same as in pyproject.toml; the files that cadtof writes contain it."""

__version__ = "0.2.0.dev0"
