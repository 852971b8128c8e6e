"""What a person watches during a run: a live screen, or plain lines where there is no terminal."""

from __future__ import annotations

import math
from collections import deque
from functools import cached_property
from typing import Protocol

import numpy as np
from rich.columns import Columns
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from robotctl.app.config import RobotConfig
from robotctl.app.run_score import grid_of
from robotctl.app.sim import Progress, SimRun
from robotctl.cli.canvas import Canvas
from robotctl.cli.console import plain_console
from robotctl.model.se2 import SE2
from robotctl.model.wall_map import WallMap
from robotctl.runtime.messages import ControlState, SafetyState

_LINE_S = 5.0
_LIVE_S = 0.2
_MAP_COLUMNS, _MAP_ROWS = 60, 18
_ARROWS = "→↗↑↖←↙↓↘"
_STATE_STYLE = {
    SafetyState.BOOT: "dim",
    SafetyState.STANDBY: "yellow",
    SafetyState.ARMED: "green",
    SafetyState.DRIVING: "bold green",
    SafetyState.FAULT: "bold red",
    SafetyState.EMERGENCY_STOP: "bold white on red",
}


class View(Protocol):
    """Shows the progress of a run; a context manager."""

    def __enter__(self) -> View:
        """Begin to show."""

    def __exit__(self, *_error: object) -> None:
        """Give the terminal back."""

    def update(self, progress: Progress) -> None:
        """Show a new state."""


def make_view(run: SimRun, *, headless: bool) -> View:
    """Return the live screen on a terminal, else plain lines."""
    console = plain_console()
    if headless or not console.is_terminal:
        return LineView(console, run.config, run.connections)
    return LiveView(console, run.config, run.walls, run.connections)


class LineView:
    """A line for each notice and one each five seconds.

    Parameters
    ----------
    console
        Where to print.
    config
        The robot.
    connections
        Where others can connect.
    """

    def __init__(self, console: Console, config: RobotConfig, connections: tuple[str, ...]) -> None:
        self._console = console
        self._config = config
        self._connections = connections
        self._printed_s = -math.inf

    def __enter__(self) -> LineView:
        """Begin to show."""
        for connection in self._connections:
            self._print(0.0, f"connect: {connection}")
        return self

    def __exit__(self, *_error: object) -> None:
        """Nothing to give back."""

    def update(self, progress: Progress) -> None:
        """Print what is new."""
        for line in progress.lines:
            self._print(progress.elapsed_s, line)
        progress.lines.clear()
        control, navigation = progress.control, progress.navigation
        if control is None or progress.elapsed_s - self._printed_s < _LINE_S:
            return
        self._printed_s = progress.elapsed_s
        item = (
            f"{navigation.mode.name} {navigation.item}/{navigation.items} {navigation.item_name}"
            if navigation is not None
            else ""
        )
        self._print(
            progress.elapsed_s,
            f"{control.state.name} {item} x {control.x_m:.2f} m y {control.y_m:.2f} m "
            f"{math.degrees(control.theta_rad):.0f}° v {_measured(control.v_m_s)} m/s "
            f"lag p99 {control.loop.lag_us_p99:.0f} µs bus {100 * control.bus.load:.0f} %",
        )

    def _print(self, elapsed_s: float, line: str) -> None:
        """Print one line with the time of the run."""
        self._console.print(f"{elapsed_s:7.1f} s  {line}", soft_wrap=True)


class LiveView:
    """A screen: state, map, wheels, sonars, loop and bus.

    Parameters
    ----------
    console
        The terminal.
    config
        The robot.
    walls
        Of the world.
    connections
        Where others can connect, for the head of the screen.
    """

    def __init__(
        self,
        console: Console,
        config: RobotConfig,
        walls: WallMap,
        connections: tuple[str, ...],
    ) -> None:
        self._console = console
        self._config = config
        self._walls = walls
        self._connections = connections
        self._notices: deque[str] = deque(maxlen=5)
        self._trail: deque[tuple[float, float]] = deque(maxlen=2000)
        self._shown_s = -math.inf
        self._live = Live(console=console, auto_refresh=False, screen=False)

    def __enter__(self) -> LiveView:
        """Take the terminal."""
        self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Give the terminal back; the last screen stays."""
        self._live.stop()

    @cached_property
    def _drawn_walls(self) -> Canvas:
        """The walls, drawn once: a map has thousands."""
        canvas = Canvas(_MAP_COLUMNS, _MAP_ROWS, self._walls.bounds)
        for x1_m, y1_m, x2_m, y2_m in self._walls.segments:
            canvas.line(x1_m, y1_m, x2_m, y2_m)
        return canvas

    def update(self, progress: Progress) -> None:
        """Redraw, five times a second at most."""
        self._notices += [f"{progress.elapsed_s:6.1f} s  {line}" for line in progress.lines]
        progress.lines.clear()
        if progress.elapsed_s - self._shown_s >= _LIVE_S:
            self._shown_s = progress.elapsed_s
            self._live.update(self.screen(progress), refresh=True)

    def screen(self, progress: Progress) -> Group:
        """Lay out the whole screen."""
        control = progress.control
        parts: list[object] = [self._head(progress)]
        if control is not None:
            self._trail.append((control.x_m, control.y_m))
            tables = Group(self._motion(control), self._sonars(control), self._health(control))
            parts.append(Columns([self._map(progress), tables]))
        parts += [Text(line, overflow="ellipsis", no_wrap=True) for line in self._notices]
        return Group(*parts)  # type: ignore[arg-type]

    def _head(self, progress: Progress) -> Text:
        """Name, state, mode and mission item."""
        control, navigation = progress.control, progress.navigation
        text = Text(f"{self._config.robot.name}  {progress.elapsed_s:6.1f} s  ")
        if control is None:
            text.append("waiting for the control process")
        else:
            text.append(f" {control.state.name} ", style=_STATE_STYLE[control.state])
            if control.state not in (SafetyState.ARMED, SafetyState.DRIVING):
                text.append(f" {control.reason}")
        if navigation is not None:
            text.append(
                f"  {navigation.mode.name}  {navigation.mission} "
                f"{navigation.item}/{navigation.items} {navigation.item_name}"
            )
        text.append("\nconnect: " + "  ".join(self._connections), style="dim")
        return text

    def _map(self, progress: Progress) -> Panel:
        """Walls or the growing map, trail, particles, things that the camera sees, truth."""
        if progress.map is None:
            canvas = self._drawn_walls.copy()
        else:
            canvas = Canvas(_MAP_COLUMNS, _MAP_ROWS, self._walls.bounds)
            grid = grid_of(progress.map)
            for x_m, y_m in grid.centre_of(np.argwhere(grid.occupied())):
                canvas.point(x_m, y_m)
        for x_m, y_m in self._trail:
            canvas.point(x_m, y_m)
        if progress.cloud is not None:
            for x_m, y_m, _ in np.frombuffer(progress.cloud.poses, "<f4").reshape(-1, 3):
                canvas.point(x_m, y_m)
        if progress.truth is not None:
            canvas.mark(progress.truth.x_m, progress.truth.y_m, "o")
        if progress.control is not None:
            control = progress.control
            here = SE2(control.x_m, control.y_m, control.theta_rad)
            for thing in progress.view.obstacles if progress.view is not None else ():
                canvas.mark(*here.apply(thing.x_m, thing.y_m), "x")
            arrow = _ARROWS[round(control.theta_rad / (math.pi / 4)) % 8]
            canvas.mark(control.x_m, control.y_m, arrow)
        return Panel("\n".join(canvas.lines()), title=_map_title(progress), expand=False)

    def _motion(self, control: ControlState) -> Table:
        """Pose, velocity and each wheel."""
        table = Table.grid(padding=(0, 2))
        table.add_row(
            "pose",
            f"{control.x_m:6.2f} m {control.y_m:6.2f} m {math.degrees(control.theta_rad):6.1f}°",
        )
        table.add_row(
            "driven", f"{control.distance_m:.1f} m (odometer {control.odometer_m / 1000:.3f} km)"
        )
        table.add_row(
            "velocity",
            f"{_measured(control.v_m_s):>5} m/s (ref {control.v_ref_m_s:5.2f}) "
            f"{_measured(control.omega_rad_s):>5} rad/s (ref {control.omega_ref_rad_s:5.2f})",
        )
        for index, name in enumerate(self._config.drive.wheel_names):
            current = f"{control.current_a[index]:5.2f} A" if control.current_a else ""
            table.add_row(
                name,
                f"{_measured(control.wheel_rad_s[index]):>6} rad/s "
                f"(ref {control.wheel_ref_rad_s[index]:6.2f}) "
                f"duty {control.duty[index]:5.2f} {current}",
            )
        if self._config.drive.steered:
            table.add_row("steering", f"{math.degrees(control.steering_rad):5.1f}°")
        return table

    def _sonars(self, control: ControlState) -> Table:
        """Show a bar for each sonar."""
        table = Table.grid(padding=(0, 2))
        for mount, range_m in zip(self._config.sonar, control.sonar_m, strict=True):
            if math.isnan(range_m):
                text = "-"
            elif math.isinf(range_m):
                text = "no echo"
            else:
                text = f"{range_m:5.2f} m {'▉' * min(20, round(4 * range_m))}"
            table.add_row(mount.name, text)
        return table

    def _health(self, control: ControlState) -> Table:
        """Battery, loop and bus."""
        table = Table.grid(padding=(0, 2))
        loop, bus, battery = control.loop, control.bus, control.battery
        if battery is not None:
            table.add_row("battery", f"{battery.voltage_v:.1f} V {100 * battery.charge:.0f} %")
        table.add_row(
            "loop",
            f"{loop.rate_hz:.0f} Hz, lag p50 {loop.lag_us_p50:.0f} p99 {loop.lag_us_p99:.0f} "
            f"max {loop.lag_us_max:.0f} µs, {loop.overruns} overruns",
        )
        table.add_row(
            "bus",
            f"{bus.state.name.lower()}, load {100 * bus.load:.0f} %, "
            f"{bus.received + bus.sent} frames, {bus.error_frames} error frames",
        )
        return table


def _measured(value: float) -> str:
    """Write a measured value, which is nan where nobody measures it now."""
    return "-" if math.isnan(value) else f"{value:.2f}"


def _map_title(progress: Progress) -> str:
    """Say what the map shows, and how well the robot knows its place."""
    state = progress.localisation
    if state is None:
        return "map" if progress.map is None else "map as it grows"
    sigma_m = math.sqrt(max(0.0, state.covariance[0] + state.covariance[3]))
    particles = f", {state.particles} particles" if state.particles else ""
    return f"{state.method}: {state.status.name.lower()}, ±{sigma_m:.2f} m{particles}"
