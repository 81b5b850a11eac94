"""OpenEXR files: frames, planes and maps."""
