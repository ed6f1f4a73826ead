"""Stage with three drives, small enough for thousands of calls, and its controllers."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import control
import numpy as np

from ftc import (
    ControlTask,
    DirectDrive,
    Goal,
    GuardedController,
    LocalGeometry,
    LoopShape,
    Measurement,
    PrioritizedController,
    PrioritizedMapping,
    Supervisor,
    compensator,
)
from ftc.fdi import NominalModel, monitor
from prioritized import ConstrainedSystem

PERIOD_S, N, M1 = 1e-3, 3, 2
J = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, -1.0]])
GOAL, DRIVES = Goal(joint_weight=(1.0,) * N), DirectDrive()
STILL, DESIRED = np.zeros(N), np.array([1e-2, -2e-2])
READ = Measurement(np.array([1e-3, 2e-3]), np.array([1e-3, 2e-3, 3e-3]))
LIMITS = (np.full(N, -1.0), np.full(N, 1.0))
SHAPE = LoopShape(5.0, 20.0, 0.7)
LOADED: dict[str, Any] = {"feedback": np.eye(N, 2 * N), "holding": np.ones(N)}
LOADED |= {"spring": np.eye(N, 2 * N), "preload": np.ones(N), "implicit_damping": False}
LOADED |= {"floor": np.ones((N, 3))}
LOADED |= {"friction": (np.eye(N), np.eye(N), np.ones(N), np.ones(N), np.ones(N))}


class Stage:
    """:class:`ftc.control.geometry.MechanismModel` of the stage; postures are displacements."""

    nominal = STILL

    def jacobians(self, posture: np.ndarray) -> Any:
        return SimpleNamespace(J_T=J, J_C=np.zeros((0, N)), active=np.arange(N), stiffness=None)

    def displacements(self, posture: np.ndarray) -> np.ndarray:
        return posture

    def task(self, posture: np.ndarray) -> np.ndarray:
        return J @ posture

    def moved(
        self, posture: np.ndarray, displacements: np.ndarray, fixed: np.ndarray
    ) -> np.ndarray:
        return displacements


class Still:
    """Machine at rest with noisy sensors of floats or integers."""

    def __init__(self, of: Any = float) -> None:
        self.rng, self.of = np.random.default_rng(1), of

    def measure(self) -> Measurement:
        size = 1.0 if self.of is int else 1e-3
        return Measurement((size * self.rng.normal(size=M1)).astype(self.of), np.zeros(N, self.of))

    def apply(self, inputs: np.ndarray) -> None:
        """Ignore the inputs."""


def possible(faults: Any) -> bool:
    return True


@cache
def stage() -> Any:
    """Return models and controllers of the stage, and their arguments."""
    eye, none, s = np.eye(N), np.zeros((N, N)), SimpleNamespace()
    s.lower, s.drive = np.hstack([-1e4 * eye, -100.0 * eye]), 1e4 * eye
    s.A, s.B = np.vstack([np.hstack([none, eye]), s.lower]), np.vstack([none, s.drive])
    s.plant = control.ss(s.A, s.B, np.hstack([J[:M1], 0 * J[:M1]]), 0)
    s.channel = control.ss(s.A[::N, ::N], s.B[::N, :1], [[1.0, 0.0]], 0)
    s.model = {"plant": s.plant, "displacement": np.eye(N, 2 * N), "noise": np.full(M1, 1e-3)}
    s.model |= {"period_s": PERIOD_S, "step_s": PERIOD_S}
    s.nominal, s.loop = NominalModel(**s.model), compensator(s.channel, SHAPE, PERIOD_S)
    s.system = ConstrainedSystem(J, None, range(N))
    s.geometry, s.fdi_monitor = LocalGeometry(s.system), monitor(s.nominal)

    def make_controller(goal: Goal = GOAL) -> PrioritizedController[Any]:
        return PrioritizedController([s.loop] * M1, s.mapping(goal), DRIVES, 0.1)

    s.mapping = lambda goal=GOAL, **how: PrioritizedMapping(s.geometry, goal, [0, 1], [2], **how)
    s.make_controller, s.plain = make_controller, make_controller()
    s.task = ControlTask(s.nominal, J, (0, 1), GOAL, DRIVES, LIMITS, np.ones(M1))
    s.guarded = GuardedController("own", lambda _: s.plain, s.task)
    s.supervised = {"goal": GOAL, "controller": make_controller, "is_possible": possible}
    s.supervised |= {"monitor": s.fdi_monitor}
    s.supervisor = Supervisor(**s.supervised)
    reconfigured = make_controller(Goal((1.0,) * N, free=(0,)))
    s.oracle = {"initial": s.plain, "reconfigured": reconfigured, "tick": 1}
    s.oracle |= {"lost_displacements": STILL, "acting": STILL, "secondary": lambda time_s: STILL}
    return s


def simulate(controller: Any) -> Any:
    """Return the inputs that a controller sends in a few ticks from rest."""
    state = controller.start()
    sent = []
    for _ in range(3):
        state = controller.step(state, DESIRED, READ)
        sent.append(state.inputs)
    return sent
