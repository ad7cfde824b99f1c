"""A model looked at without integrating: its matrices, equations, kinematics, equilibria and class."""
