"""Measure the solvers: the tables of docs/solvers.md, made by scripts/benchmark_solvers."""
