from math import cos, sin

g = 9.81


def dyn(x, xd, th, thd, mw=0.9, Iw=0.0045, mb=6.0, Ib=0.3, l=0.45, r=0.1):
    a = mw + mb + Iw / r**2
    b = mb * l * cos(th)
    c = Ib + mb * l**2
    f = mb * l * thd**2 * sin(th)
    n = mb * g * l * sin(th)
    det = a * c - b**2
    return (c * f - b * n) / det, (a * n - b * f) / det


def rhs(t, y):
    xdd, thdd = dyn(y[0], y[1], y[2], y[3])
    return [y[1], xdd, y[3], thdd]
