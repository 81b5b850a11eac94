"""What was recorded: metadata, stored voltages, TIFF and EXR readers, discovery of frames in a folder."""
