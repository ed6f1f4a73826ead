"""What is surveyed: a robot of an MJCF file at its start, or an effectiveness matrix."""

import csv
import hashlib
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from fjh.rig.bodies import model_name
from fjh.rig.conditions import FREE, SOUND, Codes
from fjh.rig.examined import Limits
from fjh.rig.options import RobotOptions
from fjh.rig.robot import Robot, left_out_of, robot_of
from fjh.rig.units import ROWS
from fjh.study.errors import WrongInput
from fjh.study.interrupts import printable
from fjh.study.spelling import check_file, nearest
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Array, Drive, ModelError, model_sha256
from sim.mjcf.drive import names_of
from sim.mjcf.transmission import drives

_INTEGRATOR = int(mujoco.mjtDyn.mjDYN_INTEGRATOR)
_FIXED, _AFFINE = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtBias.mjBIAS_AFFINE)

LARGEST = 1e12  # of the numbers; larger ones are mistakes, and their squares would overflow
MOST = 200  # rows or columns
MOST_CHARACTERS = 200  # of a cell: a name is shown in tables and pictures


@dataclass(frozen=True, eq=False)
class Limited:
    """Limits of the actuators, and where they come from.

    Where none are stated, they are one unit for each actuator, and numbers compare conditions with
    each other, and say nothing absolute.
    """

    values: Limits  # lower and upper ones, (n,) each
    source: str | None  # None where none are stated


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot at its start, or an effectiveness matrix; units are "rad" or "m", of a matrix "1"."""

    title: str  # name of the file
    sha256: str  # of the file
    actuators: tuple[str, ...]  # names; columns of the matrix
    units: tuple[str, ...]  # of each actuator's displacement
    rows: tuple[str, ...]  # names of all task rows: of the twist, or of the matrix
    row_units: tuple[str, ...]  # of the displacement of each
    major: tuple[int, ...]  # the major ones by number
    system: ConstrainedSystem  # at the start; of a matrix B it is v = B u without loops
    rates: Limited  # of the actuators' velocities; of a matrix those of its inputs
    torques: Limited | None = None  # of the actuators' forces and torques; None of a matrix
    robot: Robot | None = None  # at its start, with the model; None of a matrix
    hold: Array | None = None  # effects that the inputs of a matrix exert at rest, (m1,)
    warnings: tuple[str, ...] = ()  # what numbers leave out, a sentence each
    instead: str | None = None  # which posture stands for a start without the task, a sentence

    @property
    def secondary(self) -> tuple[int, ...]:
        """The other rows, ascending."""
        return tuple(row for row in range(len(self.rows)) if row not in self.major)

    @property
    def measure(self) -> str:
        """What is compared in the worst direction: "speed", of a matrix "effect"."""
        return "effect" if self.robot is None else "speed"

    def limits_about_rest(self, codes: Codes) -> Limits:
        """Limits of the working inputs less what these exert at rest in each condition, (C, n).

        (n,) where nothing is held, because they exert nothing.

        Locked inputs are stuck at what they exert at rest without failures, free ones are zero, and
        the others hold what is then missing, with least norm. Where they cannot, the task is lost.
        """
        lower, upper = self.rates.values
        if self.hold is None:
            return lower, upper
        at_rest = self.system.kinematics().velocity_mapping(
            self.major,
            joint_weight=np.ones(len(self.actuators)),  # of least norm within the limits
            rate_limits=self.rates.values,
        )
        B, works = self.system.J_T[list(self.major)], codes == SOUND
        stuck = np.where(works | (codes == FREE), 0.0, at_rest(self.hold))
        missing = self.hold - stuck @ B.T
        inverse = np.linalg.pinv(B * works[:, None, :], rcond=self.system.rank_tolerance)
        resting = (inverse @ missing[..., None])[..., 0]
        return lower - resting, upper - resting


def common(units: tuple[str, ...]) -> str:
    """The unit that all have, else "mixed"."""
    return units[0] if len(set(units)) == 1 else "mixed"


def matrix_subject(
    file: Path, lower: str | None, upper: str | None, major: str | None, hold: str | None
) -> Subject:
    """What a file's matrix B is surveyed as: effects = B inputs.

    Args:
        file: Rows are effects, columns inputs; a first row and a first column may be names.
        lower: Limits of the inputs: a number, or a file with one for each.
        upper: Likewise.
        major: Rows by number or name, with commas; None is all of them.
        hold: Effects at rest, one a major row, with commas; None is none.

    Raises:
        WrongInput: Any of them is none; one sentence says where and why.
    """
    B, row_names, columns = read_matrix(file, "--matrix")
    names = columns or tuple(f"u{k + 1}" for k in range(B.shape[1]))
    rows = row_names or tuple(f"row {k}" for k in range(len(B)))
    chosen = chosen_rows(major, row_names, len(rows))
    return Subject(
        title=printable(file.stem),
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        actuators=names,
        units=("1",) * len(names),
        rows=rows,
        row_units=("1",) * len(rows),
        major=chosen,
        system=ConstrainedSystem(B, None, range(len(names))),
        rates=input_limits(lower, upper, names),
        hold=None if hold is None else numbers("--hold", hold, len(chosen)),
    )


def robot_subject(
    file: Path | None, options: RobotOptions, lower: str | None, upper: str | None
) -> Subject:
    """A robot at its start; no file is the testbed's hexapod.

    Args:
        file: MJCF.
        options: Its task.
        lower: Limits of the actuators' rates, as of a matrix' inputs; None is those of the file.
        upper: Likewise.

    Raises:
        WrongInput: Limits of another number, or of none.
        sim.ModelError: The file, or what it says.
    """
    path = HEXAPOD_MJCF if file is None else file
    robot = robot_of(path, options, settle=False)
    driven = drives(robot.scene.own)
    names = tuple(own for own, *_ in names_of(driven))
    jac, rates = robot.rigid.nominal, _rates(driven)
    if rates is None or lower is not None or upper is not None:
        rates = input_limits(lower, upper, names)
    try:
        springs_count = robot.springs_count
    except ModelError:  # without position servos nothing says how stiff they would have to be
        springs_count = robot.springs_hold
    return Subject(
        title=printable(model_name(robot.model, path)),
        sha256=model_sha256(path),
        actuators=names,
        units=tuple(drive.unit for drive in driven),
        rows=ROWS,
        row_units=("rad",) * 3 + ("m",) * 3,
        major=options.major,
        system=ConstrainedSystem.of(jac, springs_count),
        rates=rates,
        torques=_torques(driven),
        robot=robot,
        warnings=(*left_out_of(robot), *robot.scene.moved, *jac.warnings),
    )


def robot_options(model: Path | None, *, major: str | None, **given: object) -> RobotOptions:
    """Options of a robot, defaults for None; of the hexapod its own axes.

    Raises:
        WrongInput: The major rows are none.
    """
    usual: dict[str, object] = {"axes": "base"} if model is None else {}
    if major is not None:
        usual["major"] = major
    given = usual | {name: value for name, value in given.items() if value is not None}
    return RobotOptions(**given)  # type: ignore[arg-type]


def input_limits(lower: str | None, upper: str | None, names: tuple[str, ...]) -> Limited:
    """Of the inputs, or rates; without any from -1 to 1 each.

    Raises:
        WrongInput: Not a number and no file of as many, or a lower one above its upper one.
    """
    n = len(names)
    if lower is None and upper is None:
        return Limited((-np.ones(n), np.ones(n)), None)
    low = np.full(n, -np.inf) if lower is None else side("--lower", lower, n)
    high = np.full(n, np.inf) if upper is None else side("--upper", upper, n)
    for name, least, most in zip(names, low, high, strict=True):
        if least > most:
            raise WrongInput(f"--lower of {name} is above its --upper: {least:g} > {most:g}")
    return Limited((low, high), "as given by --lower and --upper")


def read_matrix(file: Path, option: str) -> tuple[Array, tuple[str, ...], tuple[str, ...]]:
    """The numbers of a file, and names of rows and columns where these have some.

    They are separated by commas, semicolons, tabs or blanks; # begins a comment. A first row, or a
    first column, in which nothing is a number has names.

    Raises:
        WrongInput: There is no such file, or no such matrix in it.
    """
    called = f"{option} {file}"
    try:
        check_file(file)
        text = file.read_text(encoding="utf-8-sig")
    except WrongInput as error:
        raise WrongInput(f"{option}: {error}") from None
    except (OSError, UnicodeDecodeError):
        raise WrongInput(f"{called} is no text file that can be read") from None
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    cells = [_cells(line, f"{called}: row {k}") for k, line in enumerate(lines, 1)]
    has_header = bool(cells) and not any(map(is_number, cells[0][1:] or cells[0]))
    header, body = (cells[0], cells[1:]) if has_header else ([], cells)
    has_names = all(len(line) > 1 and not is_number(line[0]) for line in body)
    rows = [line[0] for line in body] if has_names else []
    values = _numeric([line[1:] if has_names else line for line in body], called)
    width = values.shape[1]
    if has_header and len(header) not in (width, width + has_names):
        raise WrongInput(f"{called}: the first row has {len(header)} names for {width} columns")
    columns = header[len(header) - width :] if has_header else []
    for what, names in (("rows", rows), ("columns", columns)):
        if len(set(names)) < len(names) or "" in names:
            raise WrongInput(f"{called}: names of {what} must differ and not be empty")
    return values, tuple(rows), tuple(columns)


def _cells(line: str, called: str) -> list[str]:
    """The cells of a row, with nothing in them that would command a terminal."""
    mark = next((each for each in ",;\t" if each in line), None)
    try:
        cells = line.split() if mark is None else next(csv.reader([line], delimiter=mark))
    except csv.Error as error:
        raise WrongInput(f"{called} cannot be read: {error}") from None
    if (longest := max(map(len, cells))) > MOST_CHARACTERS:
        raise WrongInput(
            f"{called} has a cell of {longest:,} characters; at most {MOST_CHARACTERS} are taken"
        )
    return [printable(cell.strip()) for cell in cells]


def _numeric(cells: list[list[str]], called: str) -> Array:
    if not cells or not cells[0]:
        raise WrongInput(f"{called} has no numbers")
    width = len(cells[0])
    if max(len(cells), width) > MOST:
        raise WrongInput(f"{called} has more than {MOST} rows or columns")
    for k, line in enumerate(cells, 1):
        if len(line) != width:
            raise WrongInput(f"{called}: row {k} has {len(line)} numbers, row 1 has {width}")
        for column, cell in enumerate(line, 1):
            if not (is_number(cell) and abs(float(cell)) < LARGEST):
                raise WrongInput(
                    f"{called}: row {k}, column {column} must be a number below {LARGEST:g}, got "
                    f"{cell:.40}"
                )
    return np.array(cells, dtype=float)


def is_number(cell: str) -> bool:
    """Whether Python reads a number in the text, be it infinite or none."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def side(option: str, text: str, n: int) -> Array:
    """Limits of n inputs on one side: a number for all, or a file with one for each.

    Raises:
        WrongInput: Neither of these.
    """
    value = np.array([float(text)]) if is_number(text) else read_matrix(Path(text), option)[0]
    if value.size not in (1, n) or not (np.abs(value) < LARGEST).all():
        raise WrongInput(
            f"{option} must be a number below {LARGEST:g} or a file with {n} of them, got "
            f"{text:.80}" + (f" with {value.size}" if value.size not in (1, n) else "")
        )
    return np.broadcast_to(value.ravel(), n).copy()


def numbers(option: str, text: str, count: int) -> Array:
    """So many numbers with commas between.

    Raises:
        WrongInput: Others.
    """
    values = text.split(",")
    if len(values) != count or not all(map(is_number, values)):
        raise WrongInput(f"{option} must be {count} numbers with commas between, got {text:.80}")
    found = np.array([float(value) for value in values])
    if not (np.abs(found) < LARGEST).all():
        raise WrongInput(f"{option} must be numbers below {LARGEST:g}, got {text:.80}")
    return found


def chosen_rows(major: str | None, names: tuple[str, ...], count: int) -> tuple[int, ...]:
    """Major rows by number or name with commas between; None is all of them.

    Raises:
        WrongInput: Others, or one twice.
    """
    if major is None:
        return tuple(range(count))
    known = {str(k): k for k in range(count)} | {name: k for k, name in enumerate(names)}
    found = []
    for text in map(str.strip, major.split(",")):
        row = known.get(text)
        if row is None or row in found:
            near = nearest(text, names or known, listed=True)
            raise WrongInput(f"--major must be different rows of the matrix, got {text:.80}{near}")
        found.append(row)
    return tuple(found)


def _rates(driven: tuple[Drive, ...]) -> Limited | None:
    """Of velocity servos, which alone have limits of rates in MJCF; None where there is none."""
    lower, upper = np.array([_rate_range(drive) for drive in driven]).T
    if not (np.isfinite(lower) | np.isfinite(upper)).any():
        return None
    return Limited((lower, upper), "control ranges of velocity actuators")


def _rate_range(drive: Drive) -> tuple[float, float]:
    """What all servos of a drive can command."""
    each = zip(drive.ids, drive.gear, strict=True)
    ends = np.sort([_servo_range(drive.model, k) / gear for k, gear in each], axis=1)
    return float(ends[:, 0].max()), float(ends[:, 1].min())


def _servo_range(model: mujoco.MjModel, actuator: int) -> Array:
    """Commanded speeds of an actuator's length: of `velocity` and `intvelocity`; else infinite."""
    control, endless = int(model.actuator_ctrladr[actuator]), np.array([-np.inf, np.inf])
    kinds = model.actuator_gaintype[actuator], model.actuator_biastype[actuator]
    if kinds != (_FIXED, _AFFINE) or not model.actuator_ctrllimited[control]:
        return endless
    gain, bias = model.actuator_gainprm[actuator, 0], model.actuator_biasprm[actuator]
    integrates = model.actuator_dyntype[actuator] == _INTEGRATOR
    follows_speed = gain != 0.0 and bias[1] == 0.0 and bias[2] == -gain
    return model.actuator_ctrlrange[control] if integrates or follows_speed else endless


def _torques(driven: tuple[Drive, ...]) -> Limited:
    """Ranges of the forces of all actuators of a drive together, as the file states them."""
    each = np.array([drive.force_range for drive in driven])
    if not np.isfinite(each).any():
        one = np.ones(len(each))
        return Limited((-one, one), None)
    return Limited((each[:, 0], each[:, 1]), "force ranges of the file, without gravity")
