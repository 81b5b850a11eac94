"""Files that other software writes: cases for the readers, used by tests and by the table in docs/formats.md."""
