"""Figures in the style of matplotlib itself: a user's `matplotlibrc` may ask for other sizes, or for a LaTeX that is missing."""

import matplotlib as mpl
from matplotlib.figure import Figure

mpl.rcdefaults()

__all__ = ["Figure"]
