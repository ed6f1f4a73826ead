"""Figures 4, 5 and 6 of the paper, from the runs of Table I."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.palette import DESIRED, MEASURED, START
from experiments.run import Trajectory

LIMIT_URAD = 125

SECONDARY = [("$t_x$, µm", 1), ("$t_y$, µm", 2), ("$t_z$, µm", 3), ("$\\gamma$, µrad", 0)]
"""Label and column of `Trajectory.secondary`, in the order of the paper's weights."""


def figure_4(runs: dict[str, Trajectory]) -> Figure:
    """Spirals and strut inputs when weighted strut displacements are minimized."""
    names = ["W_a", "W_b", "W_c"]
    figure = Figure(figsize=(11, 12.6), layout="constrained")
    figure.suptitle("Fig. 4: weighted strut displacements minimized")
    rows = figure.add_gridspec(len(names), 2, width_ratios=[1, 1.5])
    for row, name in enumerate(names):
        run = runs[name]
        axes = figure.add_subplot(rows[row, 0], title=_weight(name))
        spiral(axes, run, LIMIT_URAD)
        struts = rows[row, 1].subgridspec(3, 2)
        for k in range(6):
            axes = figure.add_subplot(struts[k // 2, k % 2], ylim=(-5, 5))
            axes.plot(run.time_s, run.strut_input_percent[:, k], color=MEASURED, lw=0.8)
            axes.set_ylabel(f"Input {k + 1}, %")
            axes.grid(alpha=0.3)
            axes.tick_params(labelbottom=k >= 4, labelleft=k % 2 == 0)
            if k >= 4:
                axes.set_xlabel("time, s")
    return figure


def figure_5(runs: dict[str, Trajectory]) -> Figure:
    """Spiral with strut 1 locked and nothing done about it."""
    figure = Figure(figsize=(5, 5), layout="constrained")
    figure.suptitle("Fig. 5: strut 1 locked, no correction")
    spiral(figure.add_subplot(), runs["W_a_uncorrected"], LIMIT_URAD)
    return figure


def figure_6(runs: dict[str, Trajectory]) -> Figure:
    """Spirals and secondary motion with strut 1 locked and the mapping reconfigured."""
    figure = Figure(figsize=(10, 9), layout="constrained")
    figure.suptitle("Fig. 6: strut 1 locked, mapping reconfigured")
    grid = figure.add_gridspec(5, 2, height_ratios=[6, 1.2, 1.2, 1.2, 1.2])
    for column, name in enumerate(["W_d", "W_e"]):
        run = runs[name]
        axes = figure.add_subplot(grid[0, column], title=_weight(name))
        spiral(axes, run, LIMIT_URAD)
        for row, (label, index) in enumerate(SECONDARY, 1):
            axes = figure.add_subplot(grid[row, column], ylabel=label, ylim=(-26, 26))
            axes.plot(run.time_s, 1e6 * run.secondary[:, index], color=MEASURED, lw=1)
            axes.grid(alpha=0.3)
            axes.tick_params(labelbottom=row == len(SECONDARY))
        axes.set_xlabel("time, s")
    return figure


def spiral(axes: Axes, run: Trajectory, limit_urad: float) -> None:
    """Detector reading over desired pointing, beta against alpha."""
    desired, measured = 1e6 * run.desired_rad, 1e6 * run.measured_rad
    axes.plot(*measured.T, color=MEASURED, lw=0.8, label="detector")
    axes.plot(*desired.T, color=DESIRED, lw=0.8, ls="--", label="desired")
    axes.plot(*desired[0], "o", color=START, ms=6, label="start")
    axes.set(
        xlabel="$\\alpha$, µrad",
        ylabel="$\\beta$, µrad",
        xlim=(-limit_urad, limit_urad),
        ylim=(-limit_urad, limit_urad),
        aspect="equal",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper right", fontsize="small", ncols=3)


def _weight(name: str) -> str:
    return f"$W_{name[-1]}$"
