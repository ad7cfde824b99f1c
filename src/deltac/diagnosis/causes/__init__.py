"""The dictionary of causes: what may be wrong, and the column that each adds to the equations of motion."""
