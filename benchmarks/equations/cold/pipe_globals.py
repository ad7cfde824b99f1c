"""A disc that rolls in a pipe with a pendulum from its centre: angles from the vertical."""
from math import *

m = 1.2; mp = 0.45
R = 0.9; r = 0.2
Lp = 0.55
g = 9.80665
rho = R - r


def deriv(state, t):
    a, b, wa, wb = state
    A = (1.5*m + mp)*rho**2
    B = mp*rho*Lp*cos(a - b)
    C = mp*Lp**2
    fa = -mp*rho*Lp*sin(a - b)*wb**2 - (m + mp)*g*rho*sin(a)
    fb = mp*rho*Lp*sin(a - b)*wa**2 - mp*g*Lp*sin(b)
    det = A*C - B*B
    return [wa, wb, (C*fa - B*fb)/det, (A*fb - B*fa)/det]
