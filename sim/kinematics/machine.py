"""What a model says besides its Jacobians: names, springs, limits, warnings."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np

import argument_checks as check
from sim.array import Array
from sim.closing.pin import Pin, pins_of
from sim.errors import ModelError
from sim.mjcf.accuracy import written_accuracy
from sim.mjcf.drive import Drive
from sim.mjcf.dynamics import is_slack, joint_stiffness
from sim.mjcf.frame import located
from sim.mjcf.limits import at_limits, stuck_names, tendon_row, touching
from sim.mjcf.model import name_of
from sim.mjcf.transmission import drives, extra_drives, is_disabled

_OF_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)
_UNLOADED_M = 1e-9
_MOST_NAMED = 3


class Names(NamedTuple):
    """Names of a mechanism.

    Attributes:
        velocities: The joint, tendon or actuator of each of the N velocities; those of a ball or
            free joint share one, and a joint without a name has "".
        actuators: Those that drive each active velocity; none for a variable without one.
    """

    velocities: tuple[str, ...]
    actuators: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, eq=False)
class OfAnyPose:
    """What of a :class:`Machine` no pose changes; read from the model when first asked for.

    Attributes:
        model: The model.
        variables: As of the machine.
        left_out: A sentence for each equality that does not count.
    """

    model: mujoco.MjModel
    variables: int
    left_out: tuple[str, ...] = ()

    @cached_property
    def drives(self) -> tuple[Drive, ...]:
        """See :class:`Machine`."""
        return drives(self.model)

    @cached_property
    def names(self) -> Names:
        """See :class:`Machine`."""
        joints = [self.model.joint(k).name for k in self.model.dof_jntid]
        return Names(
            velocities=(*joints, *(drive.name for drive in extra_drives(self.drives))),
            actuators=(*(drive.actuators for drive in self.drives), *((),) * self.variables),
        )

    @cached_property
    def written_accuracy(self) -> float:
        """See :class:`Machine`."""
        return written_accuracy(self.model)


@dataclass(frozen=True, eq=False)
class Machine:
    """A model in one pose; everything is read from it when first asked for.

    Attributes:
        model: The model.
        qpos: The pose.
        mocap: Positions and quaternions of bodies that are moved from outside.
        pinned: Frames that stay.
        stuck: Which joints on their limits count as stuck: none, all, or those of these names.
        variables: How many active velocities have no actuator; they follow those that have.
    """

    model: mujoco.MjModel
    qpos: Array
    mocap: tuple[Array, Array]
    pinned: tuple[Pin, ...]
    stuck: bool | tuple[str, ...]
    variables: int = 0

    def __post_init__(self) -> None:
        """Check the arguments, and keep read-only copies."""
        model = check.instance("model", self.model, mujoco.MjModel)
        qpos = check.frozen(check.exactly("qpos", self.qpos, model.nq))
        object.__setattr__(self, "qpos", qpos)
        if len(mocap := check.members("mocap", self.mocap, np.ndarray)) != 2:
            raise ValueError(f"mocap must be positions and quaternions, got {len(mocap)} arrays")
        sizes = (model.nmocap, 3), (model.nmocap, 4)
        own = [check.exactly("mocap", A, *s) for A, s in zip(mocap, sizes, strict=True)]
        object.__setattr__(self, "mocap", tuple(map(check.frozen, own)))
        object.__setattr__(self, "pinned", pins_of(model, self.pinned))
        object.__setattr__(self, "stuck", stuck_names("stuck", self.stuck))
        check.index("variables", self.variables, model.nv + 1)

    @property
    def drives(self) -> tuple[Drive, ...]:
        """What each active velocity is and what drives it, in actuator order."""
        return self.of_any_pose.drives

    @property
    def names(self) -> Names:
        """Names of the velocities and of the actuators."""
        return self.of_any_pose.names

    @property
    def written_accuracy(self) -> float:
        """Rounding of the model's numbers, in rad or relative length."""
        return self.of_any_pose.written_accuracy

    @cached_property
    def of_any_pose(self) -> OfAnyPose:
        """What no pose changes, which the machines of one reader share."""
        return OfAnyPose(self.model, self.variables)

    @cached_property
    def stiffness(self) -> Array | None:
        """K of the springs, shape (N, N); None where one is not linear in the joints' motion.

        That is so for a spatial tendon under load, too: its force turns with it.
        """
        model, extra = self.model, len(extra_drives(self.drives))
        if model.tendon_stiffnesspoly.any():
            return None
        try:
            K = np.diag(np.append(joint_stiffness(model), np.zeros(extra)))
        except ModelError:
            return None
        for k in np.flatnonzero(model.tendon_stiffness).tolist():
            if not is_slack(model, self._data, k):
                length = self._data.ten_length[k]
                stretch = length - np.clip(length, *model.tendon_lengthspring[k])
                if model.wrap_type[model.tendon_adr[k]] != _OF_JOINT and abs(stretch) > _UNLOADED_M:
                    return None
                row = tendon_row(model, self._data, int(k))
                K[: model.nv, : model.nv] += model.tendon_stiffness[k] * np.outer(row, row)
        return check.read_only(K)

    @cached_property
    def force_range(self) -> Array:
        """Least and most force along each active velocity, shape (n, 2), [N] or [N m].

        Zero where no actuator is.
        """
        of_each = [drive.force_range for drive in self.drives] + [(0.0, 0.0)] * self.variables
        return check.read_only(np.array(of_each).reshape(-1, 2))

    @cached_property
    def one_sided(self) -> Array:
        """Of each active velocity 1 or -1 if it is only pushed so, 0 if both ways, shape (n,)."""
        of_each = [drive.one_sided for drive in self.drives] + [0] * self.variables
        return check.read_only(np.array(of_each, dtype=int))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What the Jacobians leave out, a sentence each."""
        return (
            *self.of_any_pose.left_out,
            *self._limit_warnings(),
            *self._contact_warnings(),
            *self._drive_warnings(),
            *self._offset_warnings(),
        )

    @cached_property
    def _data(self) -> mujoco.MjData:
        data = mujoco.MjData(self.model)
        data.qpos[:], (data.mocap_pos[:], data.mocap_quat[:]) = self.qpos, self.mocap
        mujoco.mj_fwdPosition(self.model, data)
        return data

    def _limit_warnings(self) -> list[str]:
        if self.stuck is True:
            return []
        return [
            f'{limit.kind} "{limit.name}" rests on its limit and is taken to move freely: '
            f'stuck_at_limits=["{limit.name}"] takes it as stuck'
            for limit in at_limits(self.model, self._data)
            if not self.stuck or limit.name not in self.stuck
        ]

    def _contact_warnings(self) -> list[str]:
        rigid = self.model.body_weldid  # bodies without a joint between them are one
        held = {rigid[located(self.model, "pinned", pin.frame).body] for pin in self.pinned}
        return [
            f'"{name_of(self.model.body(b))}" touches "{name_of(self.model.body(a))}" and is taken '
            "to move freely: pinned= takes it to stand"
            for a, b in sorted(touching(self.model, self._data))
            if not {rigid[a], rigid[b]} & held
        ]

    def _offset_warnings(self) -> list[str]:
        """MuJoCo puts a site nearer than 1e-6 to the frame of its body into that frame."""
        model = self.model
        at_body = model.site_sameframe == mujoco.mjtSameFrame.mjSAMEFRAME_BODY
        dropped = np.flatnonzero(at_body & model.site_pos.any(axis=1))
        names = ", ".join(name_of(model.site(k)) for k in dropped[:_MOST_NAMED])
        more = f" and {len(dropped) - _MOST_NAMED} more" if len(dropped) > _MOST_NAMED else ""
        if not names:
            return []
        return [
            "MuJoCo drops offsets of sites below 1e-6 of the unit of length, so these are at the "
            f"origins of their bodies: {names}{more}; state the model in a smaller unit"
        ]

    def _drive_warnings(self) -> list[str]:
        disabled = [
            name_of(self.model.actuator(k))
            for k in range(self.model.nactuator)
            if is_disabled(self.model, k)
        ]
        one_sided = [drive.name for drive in self.drives if drive.one_sided]
        sentences = {
            "opt.disableactuator switches off, so not active: ": disabled,
            "actuated in one direction only, which the mappings do not know: ": one_sided,
        }
        return [words + ", ".join(names) for words, names in sentences.items() if names]
