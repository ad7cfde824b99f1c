# cart on a spring with a double hanging load; parameters set by main
import numpy as np
M = None
m1 = m2 = None
l1 = l2 = None
kc = 0.0
g = 9.81

def main(config):
    global M, m1, m2, l1, l2, kc
    M = config["M"]
    m1, m2 = config["m1"], config["m2"]
    l1, l2 = config["l1"], config["l2"]
    kc = config.get("kc", 0.0)

main({"M": 3.1, "m1": 0.8, "m2": 0.5, "l1": 0.7, "l2": 0.45, "kc": 41.0})

def xdot(t, X):
    x, t1, t2, v, w1, w2 = X
    s1, c1, s2, c2 = np.sin(t1), np.cos(t1), np.sin(t2), np.cos(t2)
    c12, s12 = np.cos(t1 - t2), np.sin(t1 - t2)
    mm = m1 + m2
    mass = [[M + mm, mm*l1*c1, m2*l2*c2],
            [mm*l1*c1, mm*l1**2, m2*l1*l2*c12],
            [m2*l2*c2, m2*l1*l2*c12, m2*l2**2]]
    f = [mm*l1*w1**2*s1 + m2*l2*w2**2*s2 - kc*x,
         -m2*l1*l2*w2**2*s12 - mm*g*l1*s1,
         m2*l1*l2*w1**2*s12 - m2*g*l2*s2]
    try:
        a = np.linalg.solve(mass, f)
    except np.linalg.LinAlgError:
        a = np.zeros(3)
    return np.array([v, w1, w2, *a])
