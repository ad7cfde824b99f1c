#!/usr/bin/env python
# coding: utf-8

# # Three-link leg (hip, knee, ankle)
# absolute angles from the vertical, foot fixed hip on the ground

# In[1]:
import numpy as np
from numpy.linalg import solve

# In[2]:
# Parameters
g = 9.81
thigh, shank, foot = 0.44, 0.43, 0.12        # [m]
m_t, m_s, m_f = 7.4, 3.2, 1.05               # [kg]
c_t, c_s, c_f = 0.19, 0.186, 0.06            # [m] to the centre of mass
J_t, J_s, J_f = 0.114, 0.047, 0.0036         # [kg m^2]
b_k = 0.35                                    # knee damping

# In[3]:
def leg(t, z):
    a, b, c = z[:3]          # thigh, shank, foot, absolute, from hanging
    da, db, dc = z[3:]

    # coupling lengths
    A = m_s * thigh * c_s + m_f * thigh * shank
    B = m_f * thigh * c_f
    C = m_f * shank * c_f

    M = np.array([[J_t + m_t*c_t**2 + (m_s + m_f)*thigh**2, A*np.cos(a - b), B*np.cos(a - c)],
                  [A*np.cos(a - b), J_s + m_s*c_s**2 + m_f*shank**2, C*np.cos(b - c)],
                  [B*np.cos(a - c), C*np.cos(b - c), J_f + m_f*c_f**2]])

    h = np.array([A*np.sin(a - b)*db**2 + B*np.sin(a - c)*dc**2,
                  -A*np.sin(a - b)*da**2 + C*np.sin(b - c)*dc**2,
                  -B*np.sin(a - c)*da**2 - C*np.sin(b - c)*db**2])

    G = g*np.array([(m_t*c_t + (m_s + m_f)*thigh)*np.sin(a),
                    (m_s*c_s + m_f*shank)*np.sin(b),
                    m_f*c_f*np.sin(c)])

    knee = b_k*(db - da)
    tau = np.array([knee, -knee, 0.])
    acc = solve(M, tau - h - G)
    return np.concatenate((z[3:], acc))

# In[4]:
z0 = np.deg2rad([30, 10, -20, 0, 0, 0])
print("initial rates", leg(0.0, z0))
