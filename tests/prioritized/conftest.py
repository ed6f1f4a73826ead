import pytest

from prioritized import ConstrainedSystem


@pytest.fixture(scope="session")
def hexapod(model) -> ConstrainedSystem:
    import mujoco

    from sim import jacobians

    jac = jacobians(model, mujoco.MjData(model), site="payload", axes="base")
    return ConstrainedSystem(jac.J_T, jac.J_C, jac.active)
