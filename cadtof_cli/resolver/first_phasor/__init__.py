"""The first phasor alone, which MPI pulls off: what there was before."""
