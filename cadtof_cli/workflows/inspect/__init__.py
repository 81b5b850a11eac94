"""What the commands do that look at captures and maps, and change neither: from `cadtof info` to `report` and `export`."""
