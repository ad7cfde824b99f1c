"""One inference: every error of a log is a vector field added to the equations, or a habit of the log.

`flow` predicts each row from the one before; `fields` are what an integrator adds to ẋ = f; `innovations`
whitens the prediction errors by Kalman's recursion; `odds` compares hypotheses by one Gram matrix;
`integrators` names methods by their numbers; `posterior` puts all of it together for a log.
"""
