"""Tasks → results on the workers of a dask scheduler."""
