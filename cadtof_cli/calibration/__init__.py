"""The defects of a camera, in three parts (dark, response, Petzval): measured, stored, and applied to frames."""
