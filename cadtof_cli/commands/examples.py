"""The example that each command's help ends with; tests/cli/test_examples.py runs them all, line by line, beside sample_data."""


def example(*lines: str) -> str:
    """Return the end of a help text: commands that work as they stand where sample_data lies, in an empty folder otherwise.

    Args:
        lines: each begins with `cadtof`; where the last needs files that are not in sample_data, those before it make them.
    """
    # \b keeps click from filling the lines
    return "\n".join(("\b", "Example:" if len(lines) == 1 else "Examples:", *(f"  {line}" for line in lines)))


def example_lines(epilog: str | None, /) -> tuple[str, ...]:
    """Return the commands in the end of a help text; nothing where it shows none."""
    return tuple(line.strip() for line in (epilog or "").splitlines() if line.startswith("  cadtof "))
