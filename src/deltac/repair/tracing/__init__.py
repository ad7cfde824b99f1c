"""Source code in: a function of Python's read onto a tape of operations, at states of the model."""
