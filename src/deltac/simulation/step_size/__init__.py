"""What a step may be: time scales of a mechanism, and the stability of a solver."""
