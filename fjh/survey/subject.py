"""What is surveyed: a robot of an MJCF file at its start, or an effectiveness matrix."""

import hashlib
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path

import numpy as np
import pandas as pd

from fjh.rig.bodies import model_name
from fjh.rig.condition_analysis import Limits
from fjh.rig.conditions import FREE, HEALTHY, Codes
from fjh.rig.options import RobotOptions, rows_of
from fjh.rig.robot import Robot, left_out_of, robot_of
from fjh.rig.units import ROWS
from fjh.study.errors import WrongInput
from fjh.study.interrupts import printable
from fjh.study.spelling import check_file
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Array, ModelError
from sim.mjcf import Drive, Law, drives, law_of, model_sha256, names_of

LARGEST = 1e12  # of the numbers; larger ones are mistakes, and their squares would overflow
MOST = 200  # rows or columns
_LETTERS = 80  # of a name in a matrix' file that are read


@dataclass(frozen=True, eq=False)
class Subject:
    """A robot at its start, or an effectiveness matrix; units are "rad" or "m", of a matrix "1".

    Where no limits are stated, they are one unit for each actuator, and numbers compare conditions
    with each other, and say nothing absolute.
    """

    file: Path
    title: str  # name of the file
    sha256: str  # of the file
    actuators: tuple[str, ...]  # names; columns of the matrix
    units: tuple[str, ...]  # of each actuator's displacement
    rows: tuple[str, ...]  # names of all task rows: of the twist, or of the matrix
    row_units: tuple[str, ...]  # of the displacement of each
    major: tuple[int, ...]  # the major ones by number
    system: ConstrainedSystem  # at the start; of a matrix B it is v = B u without loops
    rates: Limits  # of the actuators' velocities; of a matrix those of its inputs
    sources: dict[str, str | None]  # of the limits, by what they limit; None: none are stated
    torques: Limits | None = None  # of the actuators' forces and torques; None of a matrix
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
        lower, upper = self.rates
        if self.hold is None:
            return lower, upper
        at_rest = self.system.kinematics().velocity_mapping(
            self.major,
            joint_weight=np.ones(len(self.actuators)),  # of least norm within the limits
            rate_limits=self.rates,
        )
        B, works = self.system.J_T[list(self.major)], codes == HEALTHY
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
    B = read_matrix("--matrix", file)
    names, rows = tuple(B.columns), tuple(B.index)
    chosen = tuple(range(len(rows))) if major is None else rows_of("--major", major, rows)
    rates, source = input_limits(lower, upper, names)
    return Subject(
        file=file,
        title=printable(file.stem),
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        actuators=names,
        units=("1",) * len(names),
        rows=rows,
        row_units=("1",) * len(rows),
        major=chosen,
        system=ConstrainedSystem(B.to_numpy(), None, range(len(names))),
        rates=rates,
        sources={"inputs": source},
        hold=None if hold is None else numbers("--hold", hold, {len(chosen)}),
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
    driven = drives(robot.scene.task_model)
    names = tuple(own for own, *_ in names_of(driven))
    rates, source = input_limits(lower, upper, names)
    of_file = _together([_rate_range(drive) for drive in driven])
    if source is None and of_file is not None:
        rates, source = of_file, "control ranges of velocity actuators"
    forces = _together([drive.force_range for drive in driven])
    try:
        springs_count = robot.springs_count
    except ModelError:  # without position servos nothing says how stiff they would have to be
        springs_count = robot.springs_determine
    return Subject(
        file=path,
        title=printable(model_name(robot.model, path)),
        sha256=model_sha256(path),
        actuators=names,
        units=tuple(drive.unit for drive in driven),
        rows=ROWS,
        row_units=("rad",) * 3 + ("m",) * 3,
        major=options.major,
        system=ConstrainedSystem.of(robot.rigid.nominal, springs_count),
        rates=rates,
        torques=forces or input_limits(None, None, names)[0],
        sources={"rates": source, "forces": forces and "force ranges of the file, without gravity"},
        robot=robot,
        warnings=(*left_out_of(robot), *robot.scene.start_warnings, *robot.rigid.nominal.warnings),
    )


def _together(ranges: list[tuple[float, float]]) -> Limits | None:
    """The limits of all; None where all are infinite."""
    lower, upper = np.array(ranges).T
    return (lower, upper) if np.isfinite(ranges).any() else None


def _rate_range(drive: Drive) -> tuple[float, float]:
    """What all velocity servos of a drive can command: alone they have limits of rates in MJCF."""
    model, spans = drive.model, [np.array([-np.inf, np.inf])]
    for k, gear in zip(drive.ids, drive.gear, strict=True):
        control = int(model.actuator_ctrladr[k])
        with suppress(ModelError):  # of other laws than those of servos
            law = law_of(model, k)
            if model.actuator_ctrllimited[control] and law == Law(law.gain, per_speed=-law.gain):
                spans.append(np.sort(model.actuator_ctrlrange[control] / gear))
    lower, upper = np.array(spans).T
    return float(lower.max()), float(upper.min())


def input_limits(
    lower: str | None, upper: str | None, names: tuple[str, ...]
) -> tuple[Limits, str | None]:
    """Of the inputs, or rates, and where they are from; without any from -1 to 1 each, and None.

    Raises:
        WrongInput: Not a number and no file of as many, or a lower one above its upper one.
    """
    n = len(names)
    if lower is None and upper is None:
        return (-np.ones(n), np.ones(n)), None
    low = np.full(n, -np.inf) if lower is None else numbers("--lower", lower, {1, n})
    high = np.full(n, np.inf) if upper is None else numbers("--upper", upper, {1, n})
    low, high = np.broadcast_to(low, n), np.broadcast_to(high, n)
    for k in np.flatnonzero(low > high)[:1]:
        raise WrongInput(f"--lower of {names[k]} is above its --upper: {low[k]:g} > {high[k]:g}")
    return (low, high), "as given by --lower and --upper"


def read_matrix(option: str, file: Path) -> pd.DataFrame:
    """The numbers of a file, and the names of its rows and columns: "row 0" and "u1" without any.

    They are separated by commas, semicolons, tabs or blanks; # begins a line of comment. A first
    row, or a first column, in which nothing is a number has names.

    Raises:
        WrongInput: There is no such file, or no such matrix in it.
    """
    called = f"{option} {file}"
    try:
        cells = _cells(check_file(file).read_text(encoding="utf-8-sig"))
    except WrongInput as error:
        raise WrongInput(f"{option}: {error}") from None
    except (OSError, ValueError) as error:
        raise WrongInput(f"{called} cannot be read: {str(error).strip()}") from None
    values = cells.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)
    if not 0 < min(values.shape) <= max(values.shape) <= MOST:
        raise WrongInput(f"{called} must have 1 to {MOST} rows and columns of numbers")
    for row, column in np.argwhere(~(np.abs(values) < LARGEST))[:1]:
        raise WrongInput(
            f"{called}: row {row + 1}, column {column + 1} must be a number below {LARGEST:g}, got "
            f"{cells.iat[row, column]!s:.40}"
        )
    rows, columns = (
        [printable(str(name)[:_LETTERS]) for name in names]
        for names in (cells.index, cells.columns)
    )
    return pd.DataFrame(values, rows, columns)


def _cells(text: str) -> pd.DataFrame:
    """The cells as text, below and beside their names."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    mark = next((each for each in ",;\t" if any(each in line for line in lines)), None)
    read = partial(
        pd.read_csv,
        sep=mark or r"\s+",
        header=None,
        dtype=str,
        keep_default_na=False,
        skipinitialspace=True,
    )
    if not lines:
        raise ValueError("it has no numbers")
    first = read(StringIO(lines[0])).iloc[0].str.strip().tolist()
    has_header = not any(map(_is_number, first[1:] or first))
    if len(lines) == has_header:
        raise ValueError("it has no numbers")
    cells = read(StringIO("\n".join(lines[has_header:])))
    rows = [f"row {k}" for k in range(len(cells))]
    has_names = cells.shape[1] > 1 and not cells[0].map(_is_number).any()
    if has_names:
        rows = cells.pop(0).str.strip().tolist()
    width = cells.shape[1]
    columns = first[-width:] if has_header else [f"u{k + 1}" for k in range(width)]
    if has_header and len(first) not in (width, width + has_names):
        raise ValueError(f"the first row has {len(first)} names for {width} columns")
    for what, names in (("rows", rows), ("columns", columns)):
        if len(set(names)) < len(names) or "" in names:
            raise ValueError(f"names of {what} must differ and not be empty")
    return cells.set_axis(rows).set_axis(columns, axis=1)


def _is_number(cell: str) -> bool:
    """Whether Python reads a number in the text, be it infinite or none."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def numbers(option: str, text: str, counts: set[int]) -> Array:
    """Numbers with commas between, or those of a file.

    Raises:
        WrongInput: They are not so many, or none.
    """
    try:
        found = np.array(text.split(","), dtype=float)
    except ValueError:
        found = read_matrix(option, Path(text)).to_numpy().ravel()
    if found.size not in counts or not (np.abs(found) < LARGEST).all():
        wanted = " or ".join(map(str, sorted(counts)))
        raise WrongInput(
            f"{option} must be {wanted} numbers below {LARGEST:g}, or a file of them, got "
            f"{text:.80} with {found.size}"
        )
    return found
