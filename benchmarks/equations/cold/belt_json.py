"""Motor, idler and load on elastic belts."""
import json

CONFIG = json.loads("""
{
  "motor": {"J": 0.0021, "r": 0.02, "c": 0.0008},
  "idler": {"J": 0.0009, "r": 0.035, "c": 0.0003},
  "load":  {"J": 0.031,  "r": 0.06,  "c": 0.0041},
  "belts": [{"k": 5200.0, "d": 1.9}, {"k": 3100.0, "d": 1.2}]
}
""")


def model(y, t):
    th = y[0::2]
    om = y[1::2]
    wheels = [CONFIG[n] for n in ("motor", "idler", "load")]
    torque = [-w["c"] * o for w, o in zip(wheels, om)]
    for i, belt in enumerate(CONFIG["belts"]):
        a, b = wheels[i], wheels[i + 1]
        stretch = a["r"] * th[i] - b["r"] * th[i + 1]
        rate = a["r"] * om[i] - b["r"] * om[i + 1]
        pull = belt["k"] * stretch + belt["d"] * rate
        torque[i] -= pull * a["r"]
        torque[i + 1] += pull * b["r"]
    dydt = []
    for w, o, tau in zip(wheels, om, torque):
        dydt += [o, tau / w["J"]]
    return dydt
