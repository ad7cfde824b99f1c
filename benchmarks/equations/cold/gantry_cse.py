"""A gantry crane in space: bridge x, trolley y, rope angles a (in the y-z plane) and b; written by SymPy's cse."""
from numpy import array, cos, sin
from numpy.linalg import solve

mb, mt, m, L, g, dx, dy = 3.4, 1.6, 0.9, 1.3, 9.81, 0.7, 0.45


def f(t, q, u):
    x, y, a, b = q
    vx, vy, wa, wb = u
    x0 = m + mt
    x1 = cos(b)
    x2 = L*x1
    x3 = m*x2
    x4 = cos(a)
    x5 = x3*x4
    x6 = sin(a)
    x7 = L*sin(b)
    x8 = m*x7
    x9 = -x6*x8
    x10 = L**2*m
    x11 = wb**2
    x12 = wa**2
    x13 = x3*x6
    x14 = 2*wa*wb
    M = array([[mb + x0, 0, 0, x3], [0, x0, x5, x9], [0, x5, x1**2*x10, 0], [x3, x9, 0, x10]])
    h = array([-dx*vx + x11*x8, -dy*vy + x11*x13 + x12*x13 + x14*x4*x8, x3*(-g*x6 + x14*x7), -x8*(g*x4 + x12*x2)])
    return solve(M, h)
