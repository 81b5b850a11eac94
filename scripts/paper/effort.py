"""How much work the experiments do: all of it, or as much as CI has time for."""

from dataclasses import dataclass
from pathlib import Path

SEED = 2025


@dataclass(frozen=True)
class Effort:
    """Where results go, how many processes work, and how many runs there are.

    Attributes:
        out: folder of PNG, CSV and Markdown.
        jobs: number of processes.
        resolver_runs: solves of each condition; the paper has 400.
        pixel_runs: photon-by-photon recordings of each condition of Fig. 3; the paper has 200.
        photon_length: integration length of Table 1 photon by photon; the paper has 1e5.
        frames: frames that the profiles of Figs. 4 and 5 are averaged over.
    """

    out: Path
    jobs: int
    resolver_runs: int = 400
    pixel_runs: int = 200
    photon_length: float = 1.0e5
    frames: int = 16


def quick(out: Path, jobs: int) -> Effort:
    """Return an effort that takes seconds, with noisier numbers."""
    return Effort(out, jobs, resolver_runs=100, pixel_runs=10, photon_length=2.0e3, frames=2)
