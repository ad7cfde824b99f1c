m, k, Om, c = 1.2, 18.0, 0.7, 0.05


def foucault(t, y):
    z = complex(y[0], y[1]) if isinstance(y[0], float) else y[0] + 1j * y[1]
    zd = y[2] + 1j * y[3]
    zdd = -k / m * z - c / m * zd - 2j * Om * zd + Om**2 * z
    return [zd.real, zd.imag, zdd.real, zdd.imag]
