m, k, c, g = 1.3, 800.0, 2.0, 9.81


def hop(t, state):
    y, v = state
    if y < 0.0:
        force = -k * y - c * v
    else:
        force = 0.0
    return [v, force / m - g]
