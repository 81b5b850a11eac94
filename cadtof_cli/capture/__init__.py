"""What was recorded: the metadata of captures, and where their frames lie in folders and files."""
