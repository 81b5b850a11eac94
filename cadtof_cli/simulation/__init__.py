"""The pixel, its statistics, whole scenes, and the recorder that makes capture files of them."""
