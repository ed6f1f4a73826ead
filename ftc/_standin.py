"""Stand-in until velocity_mapping takes limits; to be deleted."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
from scipy.optimize import lsq_linear


def bounded(A, b, lo, hi):
    r = lsq_linear(A, b, (lo, hi), method="bvls", tol=1e-14)
    return r.x


@dataclass(frozen=True)
class Standin:
    free: object
    J_m: object
    G: object  # W1
    Gs: object  # W2 J_s
    W2: object
    lo: object
    hi: object
    when: str
    args: tuple

    def at(self, kin):
        return limited_mapping(
            kin, *self.args[:-2], rate_limits=self.args[-2], when_limited=self.args[-1]
        )

    def solve(self, v, joint=None, secondary=None):
        n = self.J_m.shape[1]
        v = np.asarray(v, float)
        x = self.free(v, joint, secondary)
        if np.all((x >= self.lo) & (x <= self.hi)):
            return SimpleNamespace(rates=x, residual=np.zeros(len(v)))
        joint = np.zeros(n) if joint is None else joint
        secondary = np.zeros(len(self.Gs)) if secondary is None else secondary
        x1 = (
            bounded(
                np.vstack([self.J_m, 1e-7 * np.eye(n)]), np.r_[v, np.zeros(n)], self.lo, self.hi
            )
            if len(v)
            else np.zeros(n)
        )
        a = self.J_m @ x1
        if len(v) and self.when == "scaled" and np.linalg.norm(v - a) > 1e-9 * np.linalg.norm(v):
            from scipy.optimize import linprog

            r = linprog(
                np.r_[np.zeros(n), -1.0],
                A_eq=np.column_stack([self.J_m, -v]) * 1e3,
                b_eq=np.zeros(len(v)),
                bounds=[*zip(self.lo, self.hi), (0, 1)],
            )
            a = (r.x[-1] if r.status == 0 else 0.0) * v
        A = np.vstack([1e6 * self.J_m, self.G, self.Gs, 1e-6 * np.eye(n)])
        b = np.r_[1e6 * a, self.G @ joint, self.W2 @ secondary, np.zeros(n)]
        x = bounded(A, b, self.lo, self.hi)
        return SimpleNamespace(rates=x, residual=v - self.J_m @ x)


def limited_mapping(kin, major, secondary, W1, W2, *, rate_limits, when_limited="least_squares"):
    keep = kin.actuators
    lo, hi = (
        np.asarray(each)[keep] if len(each) != len(keep) else np.asarray(each)
        for each in rate_limits
    )
    J = kin.J
    cut = None if W1 is None else np.asarray(W1)[keep] if len(W1) != len(keep) else np.asarray(W1)
    W1m = np.zeros((0, len(keep))) if W1 is None else np.diag(cut)
    W2m = np.zeros((len(secondary), len(secondary))) if W2 is None else np.diag(W2)
    free = kin.velocity_mapping(major, secondary, joint_weight=W1, secondary_weight=W2)
    return Standin(
        free,
        J[list(major)],
        W1m,
        W2m @ J[list(secondary)],
        W2m,
        lo,
        hi,
        when_limited,
        (major, secondary, W1, W2, rate_limits, when_limited),
    )
