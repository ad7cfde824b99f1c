"""The stable codes of findings and what each means; those of errors are in `deltac.errors`.

A code never changes its meaning, while the sentences around it may. A new kind of finding is one line
here and one in docs/codes.md; a test compares the two.
"""

from __future__ import annotations

FINDINGS: dict[str, str] = {
    # causes: changes of the model that would make it fit
    "gravity": "gravity has another magnitude or sign in the run than in the model",
    "gravity-vector": "gravity has another direction in the run than in the model",
    "mass-scale": "all masses and inertias differ by one factor",
    "body-inertia": "mass and inertia of a body differ by one factor",
    "body-mass": "the mass of a body differs",
    "body-centre": "the mass centre of a body differs",
    "body-moments": "the central moments of inertia of a body differ by one factor",
    "body-moment": "one central moment of inertia of a body differs",
    "body-tensor": "the central inertia tensor of a body differs",
    "actuator-gear": "an actuator delivers another multiple of its logged force",
    "actuator-delay": "an actuator's force acted later than logged",
    "channel-factor": "a force element acts with another multiple of its force",
    "damping": "the damping of a joint differs",
    "stiffness": "the stiffness of a joint differs",
    "armature": "the rotor inertia of a joint differs",
    "rest-angle": "the spring of a joint rests elsewhere",
    "zero-offset": "a coordinate is logged with another zero than the model's",
    "missing-damper": "the run has viscous damping that the model does not have",
    "missing-friction": "the run has dry friction that the model does not have",
    "missing-spring": "the run has a spring that the model does not have",
    "missing-rotor-inertia": "the run has a rotor inertia that the model does not have",
    "missing-contact": "forces act now and then that the model does not have, as in a contact",
    "missing-equality": "an equality constraint acts whose force the log does not hold",
    "constant-force": "a constant force acts on a joint",
    "applied-force": "a constant force acts on a body, fixed in the world",
    "applied-moment": "a constant moment acts on a body, fixed in the world",
    "thrust": "a constant force acts on a body, fixed in the body",
    "body-torque": "a constant moment acts on a body, fixed in the body",
    # what a simulation of an imported model lacks
    "not-simulated": "a part of an imported model that deltac does not simulate",
    # what a log, or its channels, show beside the model
    "channel-not-in-model": "the log has a force that the model does not have",
    "channel-differs": "a force of the model did other work than the same force in the log",
    "assumed-zero": "a force that the import left to the log is not in the log, and was taken as zero",
    "impacts": "impacts happen whose work the log does not hold",
    "residual": "which equations of motion do not close at the samples",
    "prescribed-departs": "a prescribed joint does not follow its law",
    "constraint-violation": "the motion violates a constraint",
    "constraint-drift": "the motion drifts off a constraint",
    "constraint-acceleration": "the accelerations violate a constraint, though the states do not",
    "quaternion-norm": "quaternions are not of unit length",
    "stale-stage": "forces or accelerations are of another instant than the state in their row",
    "order": "the log's columns are in another order than the model's",
    "read-in-parts": "the log was read in parts, to bound memory",
    # slips of units and conventions in a log
    "degrees": "degrees in place of radians",
    "turns": "turns in place of radians",
    "rpm": "turns per minute in place of radians per second",
    "millimetres": "millimetres in place of metres",
    "centimetres": "centimetres in place of metres",
    "time": "times in another unit than seconds",
    "sign": "a coordinate and its speed have opposite signs",
    "clock-jitter": "the time stamps scatter about an even clock",
    "clock-scale": "the times of the log are stretched or compressed by one factor",
    "gear-between-q-and-u": "a coordinate moves by another multiple than its speed says",
    "late-rows": "coordinates and speeds of a row are of different instants",
    "swapped-columns": "two speeds fit each other's coordinates",
    "clipped-column": "a speed stays at its extreme while the coordinate moves faster",
    "speed-not-rate": "a speed is not the rate of its coordinate",
    "replayed": "stepped from row to row, MuJoCo's model arrives at every row of the log",
    "replay-departs": "stepped from a row of the log, MuJoCo's model misses the next one",
    "interpolated-rows": "rows lie between the solver's steps",
    "duplicated-rows": "rows repeat the row before though the motion goes on",
    "held-columns": "coordinates or speeds are those of a slower sensor, repeated from row to row",
    "wrapped-angle": "an angle is wrapped to one turn",
    "spikes": "single values lie far off their neighbours",
    "udot-differenced": "the accelerations are a difference quotient of the speeds",
    "udot-not-of-this-row": "the accelerations are not the rates of the speeds at their rows",
    "forces-one-row-late": "the forces of a row are those of the step that led to it",
    "force-delayed": "a force acted later or earlier than the log says, by a fixed time",
    "force-limited": "a force acted within limits that the log's force exceeds",
    "forces-not-of-this-row": "the forces of a row are averaged, interpolated, held or delayed",
    "not-reproducible": "what is left in one part of a log does not tell what is left in another",
    "search-ended": "a search for causes ended with what it had when its time was up",
    "small-but-real": "a mistake within the tolerance, but far beyond its error bar",
    "work-unresolved": "works of channels that the samples are too far apart to tell",
    "quaternion-order": "quaternions scalar last (xyzw) in place of scalar first (wxyz)",
    "quaternion-conjugate": "conjugated quaternions",
    "angular-velocity-frame": "an angular velocity in the parent's components in place of the body's",
    "velocity-frame": "a velocity in body components in place of the world's",
    "gap": "rows are missing",
    "left-out": "rows in which a value is missing were left out",
    # what a study notices
    "coordinate-residual": "equations of motion do not close at the run's own states, at any step",
    "other-times": "the runs do not cover the same time",
    "few-common-times": "the runs have too few times in common to be compared",
    "other-start": "the runs do not start from the same state",
    "horizon": "motions at successive steps part before the end",
    "order-below-nominal": "the motion converges at a lower order than the solver's",
    "super-convergence": "the energy error falls faster than it must",
    "growth-bounded": "the energy error stays bounded in time",
    "growth-linear": "the energy error grows linearly in time",
    "growth-exponential": "the energy error grows exponentially in time",
    "symplectic-drift": "the energy drifts though the method is symplectic",
    "stabilised": "the run is corrected as it goes, so that one way of counting ΔC is blind",
    "momentum": "a momentum balance does not close, however small the step",
    "steps-do-not-refine": "the steps are not successive refinements of each other",
    "step-differs": "a run took another step than the one asked for",
    "step-ignored": "runs at different steps are the same",
    "stiff-step": "the step is outside the stability region of the solver",
    "ill-conditioned": "accelerations have few digits in double precision",
    "stopped": "a run ended early",
    "run-failed": "a run could not be made",
    "blown-up": "a run grew without bound",
    # what a check of equations notices
    "writes-to-input": "the function writes into its arguments",
    "motor": "motors without a law were taken to exert nothing",
    "not-finite": "the accelerations are not finite at some states",
    "wrong-expression": "an expression of the source is wrong, and an edit makes it right",
    "coordinates": "the function is right in other coordinates",
    "parameter-value": "the function is right with another value of one parameter, or two exchanged",
    "linearised": "the function is linear, or right for small coordinates alone",
}
"""Kind of finding -> what it means. The code of a kind is "F-" and the kind in capitals."""


def finding_code(kind: str) -> str:
    """The code of a kind of finding.

    >>> finding_code("missing-damper")
    'F-MISSING-DAMPER'
    """
    return f"F-{kind.upper()}"
