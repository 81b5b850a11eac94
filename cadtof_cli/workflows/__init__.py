"""What a command does, without click: paths and settings in, files and a report out."""
