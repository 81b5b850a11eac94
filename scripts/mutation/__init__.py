"""Mutants: small changes of meaning made to the package, each of which some test must notice."""
