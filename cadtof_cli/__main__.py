"""`python -m cadtof_cli`, the same as `cadtof`."""

from cadtof_cli.cli import main

if __name__ == "__main__":
    main()
