"""TIFF files: frames, stacks, planes and maps."""
