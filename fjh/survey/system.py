"""Surveyed system: a robot of an MJCF file at its start, or an effectiveness matrix."""

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
from fjh.study.input_checks import check_file
from fjh.study.interrupts import printable
from prioritized import ConstrainedSystem
from sim import HEXAPOD_MJCF, Array, ModelError
from sim.mjcf import Drive, Law, drives, law_of, model_sha256, names_of

LARGEST = 1e12  # limit of the numbers: larger ones are mistakes, and their squares would overflow
MOST = 200  # rows or columns
_NAME_LENGTH = 80  # longer names in a matrix file are cut off


@dataclass(frozen=True, eq=False)
class AnalyzedSystem:
    """System to survey: a robot at its start posture, or an effectiveness matrix.

    Units are "rad" or "m" for a robot, "1" for a matrix. Limits that are not stated are one unit;
    then the numbers only compare conditions.
    """

    file: Path
    title: str  # name of the file
    sha256: str  # hash of the file
    actuators: tuple[str, ...]  # names; columns of the matrix
    units: tuple[str, ...]  # unit of each actuator's displacement
    rows: tuple[str, ...]  # names of all task rows: those of the twist, or of the matrix
    row_units: tuple[str, ...]  # unit of each row's displacement
    major: tuple[int, ...]  # numbers of the major rows
    constrained_system: ConstrainedSystem  # at the start; of a matrix B it is v = B u without loops
    rates: Limits  # limits of the actuators' velocities; for a matrix, those of its inputs
    sources: dict[str, str | None]  # origin of the limits by limited quantity; None: not stated
    torques: Limits | None = None  # limits of forces and torques; None for a matrix
    robot: Robot | None = None  # at its start, with the model; None for a matrix
    hold: Array | None = None  # effects that the inputs of a matrix exert at rest, (m1,)
    warnings: tuple[str, ...] = ()  # effects that the numbers do not include, one sentence each
    instead: str | None = None  # sentence on the posture that replaces an infeasible start

    @property
    def secondary(self) -> tuple[int, ...]:
        """Numbers of the rows that are not major, ascending."""
        return tuple(row for row in range(len(self.rows)) if row not in self.major)

    @property
    def measure(self) -> str:
        """Quantity compared in the worst direction: "speed" for a robot, "effect" for a matrix."""
        return "effect" if self.robot is None else "speed"

    def limits_about_rest(self, codes: Codes) -> Limits:
        """Return the limits of the inputs relative to their values at rest, (C, n) each.

        The shape is (n,) if `hold` is None, because the inputs then are zero at rest.

        In each of C conditions, locked inputs keep their value at rest without failures, free ones
        are zero, and the others supply the rest of `hold` with least norm. Where this is
        impossible, the task is lost.
        """
        lower, upper = self.rates
        if self.hold is None:
            return lower, upper
        system = self.constrained_system
        at_rest = system.kinematics().velocity_mapping(
            self.major,
            joint_weight=np.ones(len(self.actuators)),  # of least norm within the limits
            rate_limits=self.rates,
        )
        B, works = system.J_T[list(self.major)], codes == HEALTHY
        stuck = np.where(works | (codes == FREE), 0.0, at_rest(self.hold))
        missing = self.hold - stuck @ B.T
        inverse = np.linalg.pinv(B * works[:, None, :], rcond=system.rank_tolerance)
        resting = (inverse @ missing[..., None])[..., 0]
        return lower - resting, upper - resting


def common(units: tuple[str, ...]) -> str:
    """Return the unit that all rows have in common, else "mixed"."""
    return units[0] if len(set(units)) == 1 else "mixed"


def matrix_system(
    file: Path, lower: str | None, upper: str | None, major: str | None, hold: str | None
) -> AnalyzedSystem:
    """Read the effectiveness matrix B of a file, with effects = B inputs.

    Args:
        file: Rows are effects, columns inputs; a first row and a first column may be names.
        lower: Lower limits of the inputs: a number, or a file with one for each input.
        upper: Upper limits, in the same form.
        major: Rows by number or name, separated by commas; None: all rows.
        hold: Effects at rest, one per major row, separated by commas; None: zero.

    Raises:
        WrongInput: An argument is invalid; the message states the place and the reason.
    """
    B = read_matrix("--matrix", file)
    names, rows = tuple(B.columns), tuple(B.index)
    chosen = tuple(range(len(rows))) if major is None else rows_of("--major", major, rows)
    rates, source = input_limits(lower, upper, names)
    return AnalyzedSystem(
        file=file,
        title=printable(file.stem),
        sha256=hashlib.sha256(file.read_bytes()).hexdigest(),
        actuators=names,
        units=("1",) * len(names),
        rows=rows,
        row_units=("1",) * len(rows),
        major=chosen,
        constrained_system=ConstrainedSystem(B.to_numpy(), None, range(len(names))),
        rates=rates,
        sources={"inputs": source},
        hold=None if hold is None else numbers("--hold", hold, {len(chosen)}),
    )


def robot_system(
    file: Path | None, options: RobotOptions, lower: str | None, upper: str | None
) -> AnalyzedSystem:
    """Load a robot at its start posture.

    Args:
        file: MJCF; None is the hexapod of the testbed.
        options: Options of the robot's task.
        lower: Lower limits of the actuators' rates, a number or a file; None: those of the MJCF.
        upper: Upper limits, in the same form.

    Raises:
        WrongInput: The limits are not numbers, or not one per actuator.
        sim.ModelError: The file cannot be read, or its mechanism is not supported.
    """
    path = HEXAPOD_MJCF if file is None else file
    robot = robot_of(path, options, settle=False)
    driven = drives(robot.scene.task_model)
    names = tuple(name for name, *_ in names_of(driven))
    rates, source = input_limits(lower, upper, names)
    of_file = _together([_rate_range(drive) for drive in driven])
    if source is None and of_file is not None:
        rates, source = of_file, "control ranges of velocity actuators"
    forces = _together([drive.force_range for drive in driven])
    try:
        springs_count = robot.springs_count
    except ModelError:  # the required stiffness is defined for position servos only
        springs_count = robot.springs_determine
    return AnalyzedSystem(
        file=path,
        title=printable(model_name(robot.model, path)),
        sha256=model_sha256(path),
        actuators=names,
        units=tuple(drive.unit for drive in driven),
        rows=ROWS,
        row_units=("rad",) * 3 + ("m",) * 3,
        major=options.major,
        constrained_system=ConstrainedSystem.of(robot.rigid.nominal, springs_count),
        rates=rates,
        torques=forces or input_limits(None, None, names)[0],
        sources={"rates": source, "forces": forces and "force ranges of the file, without gravity"},
        robot=robot,
        warnings=(*left_out_of(robot), *robot.scene.start_warnings, *robot.rigid.nominal.warnings),
    )


def _together(ranges: list[tuple[float, float]]) -> Limits | None:
    """Return lower and upper limits as arrays; None if all are infinite."""
    lower, upper = np.array(ranges).T
    return (lower, upper) if np.isfinite(ranges).any() else None


def _rate_range(drive: Drive) -> tuple[float, float]:
    """Return the range of rates of all velocity servos of a drive; MJCF limits no other rates."""
    model, spans = drive.model, [np.array([-np.inf, np.inf])]
    for k, gear in zip(drive.ids, drive.gear, strict=True):
        control = int(model.actuator_ctrladr[k])
        with suppress(ModelError):  # the actuator is no servo
            law = law_of(model, k)
            if model.actuator_ctrllimited[control] and law == Law(law.gain, per_speed=-law.gain):
                spans.append(np.sort(model.actuator_ctrlrange[control] / gear))
    lower, upper = np.array(spans).T
    return float(lower.max()), float(upper.min())


def input_limits(
    lower: str | None, upper: str | None, names: tuple[str, ...]
) -> tuple[Limits, str | None]:
    """Return limits of inputs or rates, and their origin; (-1, 1) and None without options.

    Raises:
        WrongInput: A limit is neither a number nor a file with one number per input, or a lower
            limit exceeds an upper one.
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
    """Read a matrix from a text file, with the names of its rows and columns.

    Cells are separated by commas, semicolons, tabs or blanks; # begins a line of comment. A first
    row or column without numbers has names; default names are "row 0" and "u1", for example.

    Raises:
        WrongInput: There is no such file, or it contains no matrix.
    """
    source = f"{option} {file}"
    try:
        cells = _cells(check_file(file).read_text(encoding="utf-8-sig"))
    except WrongInput as error:
        raise WrongInput(f"{option}: {error}") from None
    except (OSError, ValueError) as error:
        raise WrongInput(f"{source} cannot be read: {str(error).strip()}") from None
    values = cells.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)
    if not 0 < min(values.shape) <= max(values.shape) <= MOST:
        raise WrongInput(f"{source} must have 1 to {MOST} rows and columns of numbers")
    for row, column in np.argwhere(~(np.abs(values) < LARGEST))[:1]:
        raise WrongInput(
            f"{source}: row {row + 1}, column {column + 1} must be a number below {LARGEST:g}, got "
            f"{cells.iat[row, column]!s:.40}"
        )
    rows, columns = (
        [printable(str(name)[:_NAME_LENGTH]) for name in names]
        for names in (cells.index, cells.columns)
    )
    return pd.DataFrame(values, rows, columns)


def _cells(text: str) -> pd.DataFrame:
    """Split text into a table of text cells whose index and columns are their names."""
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    separator = next((mark for mark in ",;\t" if any(mark in line for line in lines)), None)
    read = partial(
        pd.read_csv,
        sep=separator or r"\s+",
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
    for axis, names in (("rows", rows), ("columns", columns)):
        if len(set(names)) < len(names) or "" in names:
            raise ValueError(f"names of {axis} must differ and not be empty")
    return cells.set_axis(rows).set_axis(columns, axis=1)


def _is_number(cell: str) -> bool:
    """Return whether Python reads a text as a number, including infinity and NaN."""
    try:
        float(cell)
    except ValueError:
        return False
    return True


def numbers(option: str, text: str, counts: set[int]) -> Array:
    """Return numbers from text with commas, or from the file with this name.

    Raises:
        WrongInput: The count of numbers is not among `counts`, or a number is not below `LARGEST`.
    """
    try:
        values = np.array(text.split(","), dtype=float)
    except ValueError:
        values = read_matrix(option, Path(text)).to_numpy().ravel()
    if values.size not in counts or not (np.abs(values) < LARGEST).all():
        expected = " or ".join(map(str, sorted(counts)))
        raise WrongInput(
            f"{option} must be {expected} numbers below {LARGEST:g}, or a file with them, got "
            f"{text:.80} with {values.size}"
        )
    return values
