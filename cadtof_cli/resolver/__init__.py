"""Phasors → paths: closed form, maximum likelihood, order test, uncertainty, status bits."""
