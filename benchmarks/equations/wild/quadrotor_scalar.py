from numpy import array, cos, sin, tan

params = {"mass": 0.51, "gravity": 9.81, "Ixx": 0.0023, "Iyy": 0.0031, "Izz": 0.0044, "drag": 0.11}


def quad(x, u):
    mass, gravity, drag = params["mass"], params["gravity"], params["drag"]
    Ixx, Iyy, Izz = params["Ixx"], params["Iyy"], params["Izz"]
    phi, th, psi = x[3], x[4], x[5]
    vx, vy, vz = x[6], x[7], x[8]
    p, q, r = x[9], x[10], x[11]
    phidot = p + q * sin(phi) * tan(th) + r * cos(phi) * tan(th)
    thdot = q * cos(phi) - r * sin(phi)
    psidot = (q * sin(phi) + r * cos(phi)) / cos(th)
    ax = -drag * vx / mass
    ay = -drag * vy / mass
    az = -gravity - drag * vz / mass
    pdot = (Iyy - Izz) * q * r / Ixx + u[0] / Ixx
    qdot = (Izz - Ixx) * p * r / Iyy + u[1] / Iyy
    rdot = (Ixx - Iyy) * p * q / Izz + u[2] / Izz
    return array([vx, vy, vz, phidot, thdot, psidot, ax, ay, az, pdot, qdot, rdot])
