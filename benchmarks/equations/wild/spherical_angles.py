from math import cos, sin, tan

l, g = 0.9, 9.81


def f(t, y):
    th, ph, thd, phd = y
    thdd = sin(th) * cos(th) * phd**2 - g / l * sin(th)
    phdd = -2 * thd * phd / tan(th)
    return [thd, phd, thdd, phdd]
