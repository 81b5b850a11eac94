"""The work of each command, without click: paths and settings in, files and a report out."""
