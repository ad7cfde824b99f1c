"""One inference: every error of a log is a vector field added to the equations, or a habit of the log.

`flow` predicts each row from the one before, `forces` between them; `fields` are what an integrator adds to
ẋ = f, `integrators` the maps of known ones; `whitening` turns prediction errors into independent ones by
Kalman's recursion; `hypotheses` compares sets of causes by one Gram matrix, `methods` the maps beside them;
`inference` puts all of it together for a log, `result` and `attribution` are what it says.
"""
