"""Display of a run: a live screen, or plain lines without a terminal."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Protocol

from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from robotctl.app.scoring.score import run_message
from robotctl.app.simulation.run_status import RunStatus
from robotctl.app.simulation.sim import SimRun
from robotctl.cli.console import plain_console
from robotctl.cli.live.map_view import RunMap, legend, title
from robotctl.cli.live.sim_keys import BRIEF, HELP, what_now
from robotctl.config.robot_file import RobotConfig
from robotctl.messages.control import ControlState, SafetyState
from robotctl.model.geometry.se2 import SE2
from robotctl.model.wall_map import WallMap
from robotctl.safety.state_machine import LATCHED
from robotctl.words import counted

_LINE_S = 5.0
_LIVE_S = 0.2
_MOST_MAP_ROWS, _FEWEST_MAP_ROWS = 40, 4
_FRAME = 2
"""Lines, or twice as many columns, around the map."""
_MAP_COLUMNS, _FIGURES_COLUMNS = 60, 68
"""The map may always have the first; what is more than both is for the map."""
_FEWEST_COLUMNS = 30
"""Width that figures need beside the map."""
_NOTICES, _NOTICES_LOW = 5, 3
_LOW = 30
"""A terminal of fewer lines is low."""
_OLD, _SILENT = "dim", "bold white on red"
"""Styles for what a silent process said last, and for saying that it is silent."""
_SLOW = 0.99
"""Below this real-time factor it is shown."""
_STATE_STYLE = {
    SafetyState.BOOT: "dim",
    SafetyState.STANDBY: "yellow",
    SafetyState.ARMED: "green",
    SafetyState.DRIVING: "bold green",
    SafetyState.FAULT: "bold red",
    SafetyState.EMERGENCY_STOP: "bold white on red",
    SafetyState.MOTOR_TEST: "bold green",
}


class View(Protocol):
    """Shows the progress of a run; a context manager."""

    def __enter__(self) -> View:
        """Begin to show."""

    def __exit__(self, *_error: object) -> None:
        """Give the terminal back."""

    def update(self, progress: RunStatus) -> None:
        """Show a new state."""

    def help(self) -> None:
        """Show what the keys do, or show it no more."""


def make_view(run: SimRun, *, headless: bool, keys: bool) -> View:
    """Return the live screen on a terminal, else plain lines; `keys`: whether keys are read."""
    console = plain_console()
    if headless or not console.is_terminal:
        return LineView(console, run.config, run.connections, keys=keys)
    return LiveView(console, run.config, run.walls, run.connections, keys=keys)


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
    keys
        Whether to show the keys.
    """

    def __init__(
        self,
        console: Console,
        config: RobotConfig,
        connections: tuple[str, ...],
        *,
        keys: bool = False,
    ) -> None:
        self._console = console
        self._config = config
        self._connections = connections
        self._keys = keys
        self._printed_s = -math.inf
        self._what_now = ""
        self._is_silent = False

    def __enter__(self) -> LineView:
        """Begin to show."""
        for connection in self._connections:
            self._print(0.0, f"connect: {connection}")
        if self._keys:
            self._print(0.0, BRIEF)
        return self

    def help(self) -> None:
        """Print what the keys do."""
        for line in HELP:
            self._console.print(f"{'':11}{line}", soft_wrap=True)

    def __exit__(self, *_error: object) -> None:
        """Nothing to give back."""

    def update(self, progress: RunStatus) -> None:
        """Print new lines."""
        for line in progress.lines:
            self._print(progress.elapsed_s, line)
        progress.lines.clear()
        control, navigation = progress.control, progress.navigation
        if control is None:
            return
        silent = "; ".join(progress.silences)
        if progress.is_silent_for_long != self._is_silent:
            self._is_silent = not self._is_silent
            self._print(progress.elapsed_s, silent if self._is_silent else "all are heard again")
        now = what_now(control, keys=True) if self._keys and control.state in LATCHED else ""
        if now and now != self._what_now:
            self._print(progress.elapsed_s, now)
        self._what_now = now
        if progress.elapsed_s - self._printed_s < _LINE_S:
            return
        self._printed_s = progress.elapsed_s
        item = (
            f"{navigation.mode.name} {navigation.item}/{navigation.items} {navigation.item_name}"
            if navigation is not None
            else ""
        )
        self._print(
            progress.elapsed_s,
            f"{control.state.name} {item} {_place(progress.pose, ' ')} "
            f"v {_measured(control.v_m_s)} m/s "
            f"lag p99 {control.loop.lag_us_p99:.0f} µs bus {100 * control.bus.load:.0f} %"
            f"{_factor(progress)}{f' [{silent}]' if silent else ''}",
        )

    def _print(self, elapsed_s: float, line: str) -> None:
        """Print one line with the time of the run."""
        self._console.print(f"{elapsed_s:7.1f} s  {line}", soft_wrap=True)


class LiveView:
    """A screen as large as the terminal: what counts first, then the map, figures where they fit.

    Parameters
    ----------
    console
        The terminal.
    config
        The robot.
    walls
        Of the world.
    connections
        Where others can connect.
    keys
        Whether to show the keys.
    """

    def __init__(
        self,
        console: Console,
        config: RobotConfig,
        walls: WallMap,
        connections: tuple[str, ...],
        *,
        keys: bool = False,
    ) -> None:
        self._console = console
        self._config = config
        self._map = RunMap(walls)
        self._connections = connections
        self._keys = keys
        self._helps = False
        self._notices: deque[str] = deque(maxlen=_NOTICES)
        self._shown_s = -math.inf
        self._live = Live(console=console, auto_refresh=False, screen=False)
        self._size = console.size

    def __enter__(self) -> LiveView:
        """Take the terminal."""
        self._live.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Give the terminal back; the last screen stays."""
        self._live.stop()

    def help(self) -> None:
        """Show what the keys do in place of the map, or the map again."""
        self._helps = not self._helps
        self._shown_s = -math.inf

    def update(self, progress: RunStatus) -> None:
        """Redraw, five times a second at most."""
        for line in progress.lines:
            self._notices += [f"{progress.elapsed_s:6.1f} s  {each}" for each in line.splitlines()]
        progress.lines.clear()
        if self._console.size != self._size:
            self._begin_anew()
        if progress.elapsed_s - self._shown_s >= _LIVE_S:
            self._shown_s = progress.elapsed_s
            self._live.update(self.screen(progress), refresh=True)

    def _begin_anew(self) -> None:
        """Clear a terminal of another size, which has broken the lines that stood there."""
        self._size = self._console.size
        self._live.stop()
        self._console.clear()
        self._live = Live(console=self._console, auto_refresh=False, screen=False)
        self._live.start()
        self._shown_s = -math.inf

    def screen(self, progress: RunStatus) -> Group:
        """Lay out the whole screen, one line less than the terminal has."""
        width, height = self._console.size
        control = progress.control
        top = [*self._head(progress)]
        most = _NOTICES if height >= _LOW else _NOTICES_LOW
        page = (f"page {progress.page}",) if progress.page else ()
        connections = (*page, *self._connections)
        connect = [_line(each, "dim") for each in _packed("connect:", connections, width)]
        bottom = [*connect, *(_line(each) for each in [*self._notices][-most:])]
        rows = height - 1 - len(top) - len(connect) - most
        parts: list[object] = [*top]
        if self._helps:
            parts += [_line(each) for each in HELP]
        elif control is not None and rows - _FRAME >= _FEWEST_MAP_ROWS:
            parts.append(self._map_and_figures(progress, control, width, rows))
        return Group(*parts, *bottom)  # type: ignore[arg-type]

    def _head(self, progress: RunStatus) -> Iterator[Text]:
        """Yield state, mode and mission item; why it stands and what to do; pose; keys."""
        control, navigation = progress.control, progress.navigation
        first = _line(f"{self._config.robot.name}  {progress.elapsed_s:6.1f} s  ")
        silent, old = progress.control_silence, _OLD if progress.control_silence else ""
        if control is None:
            first.append("waiting for the control process")
        else:
            if silent:
                first.append(f" {silent} ", style=_SILENT)
            style = old or _STATE_STYLE[control.state]
            first.append(f" {control.state.name} ", style=style)
        if navigation is not None:
            nav_silent = progress.navigation_silence
            first.append(
                f"  {navigation.mode.name}  {navigation.mission} "
                f"{navigation.item}/{navigation.items} {navigation.item_name}",
                style=_OLD if nav_silent else "",
            )
            if nav_silent:
                first.append(f" {nav_silent} ", style=_SILENT)
        yield first
        if control is not None:
            message_old = old or (_OLD if progress.navigation_silence else "")
            yield _line(run_message(control, navigation), message_old)
            if navigation is None:
                yield _line("navigation starts; then the robot is armed and drives its mission")
            elif (now := what_now(control, keys=self._keys)) and not silent:
                yield _line(now, "bold")
            battery = control.battery
            charge = "battery -" if battery is None else f"battery {battery.voltage_v:.1f} V"
            if battery is not None and not math.isnan(battery.charge):
                charge += f" {100 * battery.charge:.0f} %"
            yield _line(
                f"{_place(progress.pose, '  ')}  {_measured(control.v_m_s)} m/s   "
                f"{charge}  {_factor(progress)}",
                old,
            )
        if self._keys:
            yield _line(BRIEF, "bold")

    def _map_and_figures(
        self, progress: RunStatus, control: ControlState, width: int, rows: int
    ) -> Table:
        """Lay out the map in so many lines, with figures beside it where they fit."""
        most = max(width - _FIGURES_COLUMNS, _MAP_COLUMNS)
        columns = min(most, width) - 2 * _FRAME
        canvas = self._map.draw(progress, columns, min(rows - _FRAME, _MOST_MAP_ROWS))
        panel_columns = canvas.columns + 2 * _FRAME
        panel = Panel(
            Text("\n").join(canvas.lines()),
            title=title(progress),
            subtitle=legend(progress),
            width=panel_columns,
        )
        both = Table.grid(padding=(0, 1))
        both.add_column(width=panel_columns)
        if width - panel_columns < _FEWEST_COLUMNS:
            both.add_row(panel)
            return both
        figures = [*self._motion(control), *self._sonars(control), *_health(control)][:rows]
        longest = max(len(name) for name, _ in figures)
        old = _OLD if progress.control_silence else ""
        lines = (_line(f"{name:{longest}}  {text}", old) for name, text in figures)
        both.add_row(panel, Group(*lines))
        return both

    def _motion(self, control: ControlState) -> Iterator[tuple[str, str]]:
        """Yield velocity, each wheel and the distance."""
        yield (
            "velocity",
            (
                f"{_measured(control.v_m_s):>5} m/s (ref {control.v_ref_m_s:5.2f}) "
                f"{_measured(control.omega_rad_s):>5} rad/s (ref {control.omega_ref_rad_s:5.2f})"
            ),
        )
        for index, name in enumerate(self._config.drive.wheel_names):
            current = f"{control.current_a[index]:5.2f} A" if control.current_a else ""
            yield (
                name,
                (
                    f"{_measured(control.wheel_rad_s[index]):>6} rad/s "
                    f"(ref {control.wheel_ref_rad_s[index]:6.2f}) "
                    f"duty {control.duty[index]:5.2f} {current}"
                ),
            )
        if self._config.drive.joint_names:
            yield "steering", f"{math.degrees(control.steering_rad):5.1f}°"
        yield "driven", f"{control.distance_m:.1f} m (odometer {control.odometer_m / 1000:.3f} km)"

    def _sonars(self, control: ControlState) -> Iterator[tuple[str, str]]:
        """Yield a bar for each sonar."""
        for mount, range_m in zip(self._config.sonar, control.sonar_m, strict=True):
            if math.isnan(range_m):
                text = "-"
            elif math.isinf(range_m):
                text = "no echo"
            else:
                text = f"{range_m:5.2f} m {'▉' * min(20, round(4 * range_m))}"
            yield mount.name, text


def _health(control: ControlState) -> Sequence[tuple[str, str]]:
    """Return loop and bus."""
    loop, bus = control.loop, control.bus
    return (
        (
            "loop",
            (
                f"{loop.rate_hz:.0f} Hz, lag p50 {loop.lag_us_p50:.0f} p99 {loop.lag_us_p99:.0f} "
                f"max {loop.lag_us_max:.0f} µs, {counted(loop.overruns, 'overrun')}"
            ),
        ),
        (
            "bus",
            (
                f"{bus.state.name.lower()}, load {100 * bus.load:.0f} %, "
                f"{counted(bus.received + bus.sent, 'frame')}, "
                f"{counted(bus.error_frames, 'error frame')}"
            ),
        ),
    )


def _packed(first: str, parts: Sequence[str], width: int) -> list[str]:
    """Return a word and parts in as few lines as they fit in, no part broken."""
    lines, indent = [first], " " * len(first)
    for each in parts:
        if lines[-1] not in (first, indent) and len(lines[-1]) + 2 + len(each) > width:
            lines.append(indent)
        lines[-1] += f"  {each}"
    return lines


def _line(text: str, style: str = "") -> Text:
    """Return one line that a narrow terminal cuts."""
    return Text(text.replace("\n", " "), style=style, overflow="ellipsis", no_wrap=True)


def _factor(progress: RunStatus) -> str:
    """Return how fast simulated time goes, where the computer does not keep up."""
    factor = progress.real_time_factor
    return f" {factor:.2f} × real time" if factor < _SLOW else ""


def _place(pose: SE2 | None, gap: str) -> str:
    """Write a pose in `world`, if it is known."""
    if pose is None:
        return f"x - m{gap}y - m{gap}-°"
    heading_deg = math.degrees(pose.theta_rad)
    return f"x {pose.x_m:.2f} m{gap}y {pose.y_m:.2f} m{gap}{heading_deg:.0f}°"


def _measured(value: float) -> str:
    """Write a measured value; nan: not measured now."""
    return "-" if math.isnan(value) else f"{value:.2f}"
