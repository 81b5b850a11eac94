"""NPY files: frames and planes that numpy saved."""
