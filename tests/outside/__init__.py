"""Files that other software writes: the cases that the readers are tried with, in tests and for the table in docs/formats.md."""
