"""Files and the libraries that read and write them: the only room that knows a file library."""
