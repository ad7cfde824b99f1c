"""Events within a run: where they are found, what impacts do, and the run from one to the next."""
