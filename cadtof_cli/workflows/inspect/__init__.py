"""The work of the commands that read captures and maps and change neither, from `cadtof info` to `report` and `export`."""
