import argparse
from math import cos, sin

parser = argparse.ArgumentParser(description="spring pendulum")
parser.add_argument("--mass", type=float, default=0.9)
parser.add_argument("--stiffness", type=float, default=70.0)
parser.add_argument("--rest", type=float, default=0.45)
parser.add_argument("--damping", type=float, default=0.6)
parser.add_argument("--gravity", type=float, default=9.81)
args = parser.parse_args([])
CONFIG = {"physics": vars(args), "solver": {"rtol": 1e-9, "method": "DOP853"}}


def spring(r, rdot):
    cfg = CONFIG["physics"]
    return -cfg["stiffness"] * (r - cfg["rest"]) - cfg["damping"] * rdot


def deriv(y, t):
    r, phi, rdot, phidot = y
    cfg = CONFIG["physics"]
    rddot = r * phidot**2 + cfg["gravity"] * cos(phi) + spring(r, rdot) / cfg["mass"]
    phiddot = (-cfg["gravity"] * sin(phi) - 2 * rdot * phidot) / r
    return rdot, phidot, rddot, phiddot
