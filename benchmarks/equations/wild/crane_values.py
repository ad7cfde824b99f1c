from scipy.constants import pi

M = 2.3
m = 0.7
L = 1.4
g = 9.81
bx, bt = 0.3, 0.05
turn = 2 * pi
