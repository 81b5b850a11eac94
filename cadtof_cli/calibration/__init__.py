"""What is wrong with a camera, in three parts (dark, response, Petzval): measured, stored, applied to frames."""
