"""What the machine is: bodies, joints, forces, constraints, events. Declarative, no numerics."""
