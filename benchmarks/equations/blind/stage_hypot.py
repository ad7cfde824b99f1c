import functools
import math


def _pull(x, y, vx, vy, *, anchor, k, rest, c=0.0):
    dx, dy = x - anchor, y
    length = math.hypot(dx, dy); angle = math.atan2(dy, dx)
    rate = (dx*vx + dy*vy) / length
    F = -k*(length - rest) \
        - c*rate
    return F*math.cos(angle), F*math.sin(angle)


left = functools.partial(_pull, anchor=-0.9, k=35.0, rest=0.3, c=0.2)
right = functools.partial(_pull, anchor=+0.9, k=22.0, rest=0.5)
def table(t, s, m=0.6):
    x, y, vx, vy = s
    ax = ay = 0.0
    for pull in (left, right):
        fx, fy = pull(x, y, vx, vy)
        ax += fx / m; ay += fy / m
    return (vx, vy, ax, ay)
