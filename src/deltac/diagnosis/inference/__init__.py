"""One inference: every error of a log is a vector field added to the equations, or a habit of the log.

Data flows one way. `model` evaluates the equations at rows, in `reduced` coordinates where a loop closes;
`observations` are the rows with their noise. `flow` predicts each from the one before, `forces` between them;
`fields` are what an integrator adds to ẋ = f, `integrators` the maps of known ones. `linearisation` puts
these together at a point; `whitening` makes prediction errors independent by Kalman's recursion, and
`regression` takes them on all columns. `hypotheses` compares sets of causes by one Gram matrix, `methods` the
maps beside them, `comparison` both at a point. `interpolation` moves the point to likelier forces between
rows, `inference` to places and axes, and to the causes themselves. `attribution` says what that is in joules,
`result` holds what was inferred, `joint` is of several logs.
"""
