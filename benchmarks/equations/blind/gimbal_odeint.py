from numpy import *

def make_args(argv=()):
    import argparse
    ap = argparse.ArgumentParser()
    ap.add_argument('--A', type=float, default=0.0041, help='transverse inertia about the pivot')
    ap.add_argument('--C', type=float, default=0.0067)
    ap.add_argument('--outer', type=float, default=0.0019)
    ap.add_argument('--mgl', type=float, default=0.083)
    ap.add_argument('--brake', type=float, default=0.0007)
    return ap.parse_args(list(argv))

def gyro(y, t, A, C, Jo, mgl, c):
    """Rotor on two gimbals: alpha about the vertical, beta tilt from the vertical, gamma spin"""
    al, be, ga, ald, bed, gad = y
    sb = sin(be); cb = cos(be)
    # spin momentum
    H = C*(gad + ald*cb)
    # mass matrix in alpha, gamma
    m11 = Jo + A*sb**2 + C*cb**2; m13 = C*cb; m33 = C
    Q1 = -2*A*sb*cb*ald*bed + 2*C*sb*cb*ald*bed + C*sb*bed*gad
    Q3 = C*sb*ald*bed - c*gad
    bedd = (A*sb*cb*ald**2 - H*ald*sb + mgl*sb)/A
    det = m11*m33 - m13**2
    aldd = (m33*Q1 - m13*Q3)/det
    gadd = (m11*Q3 - m13*Q1)/det
    return array([ald, bed, gad, aldd, bedd, gadd])

a = make_args()
def model(y, t):
    return gyro(y, t, a.A, a.C, a.outer, a.mgl, a.brake)
