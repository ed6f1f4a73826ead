"""Theorems 7 and 8 as printed, oracles of the force mapping."""

import numpy as np
import scipy.linalg

pinv = np.linalg.pinv


def theorem_7(J_m, J_s, W3, W4):
    """Evaluate eq. (34) as printed: gains of f_md, and of the stacked [torques_d; f_sd]."""
    K = J_s.T @ pinv(np.vstack([W3 @ J_s.T, W4]))
    major = J_m.T - K @ np.vstack([W3 @ J_m.T, np.zeros((len(J_s), len(J_m)))])
    return major, K @ scipy.linalg.block_diag(W3, W4)


def theorem_8(J_m, J_s, W3):
    """Evaluate eq. (36) as printed."""
    K = J_s.T @ pinv(W3 @ J_s.T) @ W3
    return J_m.T - K @ J_m.T, K
