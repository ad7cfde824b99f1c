"""Watt's governor: spindle angle and the angle of its arms, two balls."""
import math
from types import SimpleNamespace

import yaml

TEXT = """
spindle:
  inertia: 0.021
  drag: 0.003
balls:
  mass: 0.38
  arm: 0.22
  offset: 0.03
hinge:
  spring: 1.7
  damping: 0.012
gravity: 9.81
"""
cfg = yaml.safe_load(TEXT)
P = SimpleNamespace(**cfg["balls"], **cfg["hinge"], g=cfg["gravity"])


def governor(t, y):
    phi, th, w, v = y
    s, c = math.sin(th), math.cos(th)
    reach = P.offset + P.arm * s
    J = cfg["spindle"]["inertia"] + 2 * P.mass * reach**2
    dw = (-cfg["spindle"]["drag"] * w - 4 * P.mass * reach * P.arm * c * v * w) / J
    inertia = 2 * P.mass * P.arm**2
    moment = 2 * P.mass * P.arm * (reach * c * w**2 - P.g * s) - P.spring * th - P.damping * v
    return [w, v, dw, moment / inertia]
