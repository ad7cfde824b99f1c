I1, I2, I3 = 0.7, 1.1, 1.6


def euler(t, q, w):
    w1, w2, w3 = w
    return [
        (I2 - I3) / I1 * w2 * w3,
        (I3 - I1) / I2 * w3 * w1,
        (I1 - I2) / I3 * w1 * w2,
    ]
