"""A stage with three drives, small enough for thousands of hostile calls, and all about it."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import control
import numpy as np

from ftc import (
    ControlTask,
    DirectDrive,
    Goal,
    LocalGeometry,
    LoopShape,
    Measurement,
    PrioritizedController,
    PrioritizedMapping,
    Supervisor,
    compensator,
    tracking,
)
from ftc.fdi import NominalModel, monitor
from prioritized import ConstrainedSystem

PERIOD_S, N, M1 = 1e-3, 3, 2
J = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, -1.0]])
_I, _O = np.eye(N), np.zeros((N, N))
LOWER, DRIVE = np.hstack([-1e4 * _I, -100.0 * _I]), 1e4 * _I
A, B = np.vstack([np.hstack([_O, _I]), LOWER]), np.vstack([_O, DRIVE])
C = np.hstack([J[:M1], 0 * J[:M1]])
PLANT = control.ss(A, B, C, 0)
MODEL: dict[str, Any] = {"plant": PLANT, "displacement": np.eye(N, 2 * N)}
MODEL |= {"noise": np.full(M1, 1e-3), "period_s": PERIOD_S, "step_s": PERIOD_S}
NOMINAL = NominalModel(**MODEL)
SYSTEM = ConstrainedSystem(J, None, range(N))
GEOMETRY = LocalGeometry(SYSTEM)
CHANNEL = control.ss(A[::N, ::N], B[::N, :1], [[1.0, 0.0]], 0)
SHAPE = LoopShape(5.0, 20.0, 0.7)
LOOP = compensator(CHANNEL, SHAPE, PERIOD_S)
GOAL = Goal(joint_weight=(1.0,) * N)
DRIVES = DirectDrive()
STILL, DESIRED = np.zeros(N), np.array([1e-2, -2e-2])
READ = Measurement(np.array([1e-3, 2e-3]), np.array([1e-3, 2e-3, 3e-3]))
LIMITS = (np.full(N, -1.0), np.full(N, 1.0))
TASK = ControlTask(NOMINAL, J, (0, 1), GOAL, DRIVES, LIMITS, np.ones(M1))
WATCH = monitor(NOMINAL)


def mapping(goal: Goal = GOAL, **options: Any) -> PrioritizedMapping[Any]:
    return PrioritizedMapping(GEOMETRY, goal, [0, 1], [2], **options)


def pilot(goal: Goal = GOAL, **options: Any) -> PrioritizedController[Any]:
    return PrioritizedController([LOOP] * M1, mapping(goal), DRIVES, 0.1, **options)


PILOT = pilot()


def motionless(time_s: float) -> np.ndarray:
    return STILL


def possible(faults: Any) -> bool:
    return True


SUPERVISOR: dict[str, Any] = {"goal": GOAL, "controller": pilot, "monitor": WATCH}
SUPERVISOR |= {"is_possible": possible}
SUPERVISED = Supervisor(**SUPERVISOR)


class Still:
    """A machine that does not move, whose sensors have noise."""

    def __init__(self) -> None:
        self.rng = np.random.default_rng(1)

    def measure(self) -> Measurement:
        """Noise."""
        return Measurement(1e-3 * self.rng.normal(size=M1), np.zeros(N))

    def apply(self, inputs: np.ndarray) -> None:
        """Nothing."""


class Stage:
    """The stage as a :class:`ftc.control.geometry.MechanismModel`; postures are displacements."""

    nominal = STILL

    def jacobians(self, posture: np.ndarray) -> Any:
        """Constant."""
        return SimpleNamespace(J_T=J, J_C=np.zeros((0, N)), active=np.arange(N), stiffness=None)

    def displacements(self, posture: np.ndarray) -> np.ndarray:
        """The posture itself."""
        return posture

    def task(self, posture: np.ndarray) -> np.ndarray:
        """Linear."""
        return J @ posture

    def moved(self, posture: np.ndarray, displacements: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Where it is told to."""
        return displacements


LINEAR: dict[str, Any] = {"A": A, "B": B, "C_twist": np.hstack([J, 0 * J]), "C_active": C[:0]}
LINEAR |= {"C_active": np.eye(N, 2 * N)}
TRACKED: dict[str, Any] = {"model": Stage(), "linear": SimpleNamespace(**LINEAR), "major": [0, 1]}
TRACKED |= {"noise": np.full(M1, 1e-3), "period_s": PERIOD_S, "step_s": PERIOD_S, "goal": GOAL}
TRACK = tracking(**TRACKED, crossover_hz=5.0)


def flown(controller: Any, ticks: int = 3, **how: Any) -> Any:
    """What a controller sends in a few ticks, from rest."""
    state = controller.start()
    sent = []
    for _ in range(ticks):
        state = controller.step(state, DESIRED, READ, **how)
        sent.append(state.inputs)
    return sent


def told(make: Callable[..., Any]) -> Callable[..., Any]:
    """What a controller sends that is made of the arguments."""
    return lambda **given: flown(make(**given))
