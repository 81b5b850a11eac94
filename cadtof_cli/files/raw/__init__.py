"""Raw dumps: frames without a header, described by `[layout.raw]`."""
