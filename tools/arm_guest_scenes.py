"""What the guest of `tools/arm-guest` does: the host's agent, and the scenes.

`agent` runs the host's commands and needs nothing but Python; a scene is run by the Python that
robotctl was installed for. It ends with status 0, or says what was not as it should be. The host
does what a guest cannot do to itself: it cuts the power, and lets the controller go bus-off.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from operator import mul
from pathlib import Path
from typing import Any

PORT = Path("/dev/virtio-ports/agent")
TRUTH = "ipc:///run/firmware/truth"
STATES = Path("/run/robotctl/robotctl/robot")
PROGRESS = Path("/var/lib/robotctl/progress.json")
AUTO, HOLD = 10, 4
SO_TIMESTAMPNS, CAN_RAW_ERR_FILTER = 35, 2
"""Of asm-generic/socket.h and linux/can/raw.h."""


class SceneError(Exception):
    """Something is not as it should be."""


def agent() -> None:
    """Run the host's commands, a line of JSON each, and tell their output and status."""
    while not PORT.exists():
        time.sleep(0.1)
    with PORT.open("r+b", buffering=0) as port:

        def tell(**message: Any) -> None:
            port.write(json.dumps(message).encode() + b"\n")

        tell(booted=time.clock_gettime(time.CLOCK_BOOTTIME))
        rest = b""
        while True:
            chunk = port.read(65536)
            if not chunk:
                time.sleep(0.1)
                continue
            *orders, rest = (rest + chunk).split(b"\n")
            for order in map(json.loads, orders):
                with subprocess.Popen(
                    order["command"], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, text=True,
                ) as process:  # fmt: skip
                    assert process.stdout is not None
                    for line in process.stdout:
                        tell(line=line.rstrip("\n"))
                tell(status=process.returncode, at=time.clock_gettime(time.CLOCK_BOOTTIME))


def ask(*command: str) -> str:
    """Run a command and return its output, whatever its status is."""
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def say(text: str) -> None:
    """Tell the host something."""
    print(text, flush=True)


def service() -> dict[str, str]:
    """Return what systemd knows of the service."""
    names = "ActiveState,SubState,Result,NRestarts,MainPID,StatusText,InvocationID"
    told = ask("systemctl", "show", "robotctl", "--property", names)
    return dict(line.split("=", 1) for line in told.splitlines())


def journal(since_s: float) -> str:
    """Return what the service has said since a time of the wall clock [s]."""
    since = f"--since=@{since_s:.6f}"
    return ask("journalctl", "--unit=robotctl", since, "--output=cat", "--no-pager")


def process_of(name: str) -> int:
    """Return the process of the service with a name.

    Raises
    ------
    SceneError
        If there is none.
    """
    for path in Path("/proc").glob("[0-9]*/comm"):
        try:
            if path.read_text().strip() == name[:15]:
                return int(path.parent.name)
        except OSError:
            continue
    raise SceneError(f"no process {name}")


class Rig:
    """The operator's station (MAVLink), the robot's own states, and the truth of its wheels."""

    def __init__(self) -> None:
        # The agent has nothing but Python.
        import zmq  # noqa: PLC0415

        from firmware_sim.world.truth import Truth  # noqa: PLC0415
        from robotctl.messages.control import ControlState, NavigationState  # noqa: PLC0415
        from robotctl.runtime.ipc.topics import Endpoints, Subscriber  # noqa: PLC0415

        context: Any = zmq.Context()
        states, ends = ControlState | NavigationState, Endpoints(STATES)
        self._control = ControlState
        self._states: Any = Subscriber(context, (ends.control_state, ends.navigation_state), states)
        self._truths: Any = Subscriber(context, (TRUTH,), Truth)
        self.control: Any = None
        self.navigation: Any = None
        self.truth: Any = None
        self._station: Any = None
        self._mav: Any = None
        self._beat_s = 0.0

    def listen(self) -> None:
        """Take in what was said; the station's heartbeat goes on."""
        for state in self._states.receive():
            if isinstance(state, self._control):
                self.control = state
            else:
                self.navigation = state
        self.truth = next(reversed(self._truths.receive()), self.truth)
        if self._mav is not None and time.monotonic() - self._beat_s > 0.5:
            self._beat_s = time.monotonic()
            try:
                self._mav.heartbeat_send(6, 8, 0, 0, 0)
                self.heard()  # what nobody waits for is not worth being read
            except OSError:
                self._mav = None

    def wait(
        self, what: str, is_so: Callable[[], Any], seconds: float, every_s: float = 0.02
    ) -> None:
        """Wait until something is so, looked at again and again.

        Raises
        ------
        SceneError
            If it is not in time.
        """
        began_s = time.monotonic()
        while not is_so():
            if time.monotonic() - began_s > seconds:
                raise SceneError(f"not within {seconds:g} s: {what}\n{self.told()}")
            self.listen()
            time.sleep(every_s)
        say(f"{what}: after {time.monotonic() - began_s:.2f} s")

    def serves(self, *, active: bool = True, within_s: float = 120.0) -> None:
        """Wait until the service is active, or is not; to ask systemd costs the guest time."""
        what = "the service is active" if active else "the service has ended"
        self.wait(what, lambda: (service()["ActiveState"] == "active") is active, within_s, 0.5)

    def told(self) -> str:
        """Return all that is known, for a scene that failed."""
        states = (self.control, self.navigation, self.truth)
        return "\n".join((*map(str, states), str(service()), journal(time.time() - 30.0)))

    def connect(self) -> None:
        """Connect the station."""
        # What the robot itself loads: compiling another dialect would take the guest long.
        from pymavlink.dialects.v20 import common  # noqa: PLC0415

        while self._mav is None:
            try:
                self._station = socket.create_connection(("127.0.0.1", 5760), 1.0)
            except OSError:
                self.listen()
                time.sleep(0.2)
            else:
                file = self._station.makefile("wb", buffering=0)
                self._mav = common.MAVLink(file, srcSystem=255)
                self._mav.robust_parsing = True

    def heard(self) -> bytes:
        """Return what the robot sent to the station.

        Raises
        ------
        OSError
            If it sends nothing for a second, or has closed the link.
        """
        if not (data := self._station.recv(65536)):
            raise ConnectionResetError
        return data

    def command(self, number: int, *params: float) -> bool:
        """Send a command and return whether it was accepted."""
        self.connect()
        padded = (*params, *(0.0,) * (7 - len(params)))
        until_s = time.monotonic() + 3.0
        try:
            self._mav.heartbeat_send(6, 8, 0, 0, 0)
            self._mav.command_long_send(1, 1, number, 0, *padded)
            while time.monotonic() < until_s:
                for answer in self._mav.parse_buffer(self.heard()) or ():
                    if answer.get_type() == "COMMAND_ACK" and answer.command == number:
                        return bool(answer.result == 0)
        except OSError:
            self._mav = None
        return False

    @property
    def fresh(self) -> bool:
        """Whether control has said something within the last second."""
        age_ns = time.monotonic_ns() - (self.control.stamp_ns if self.control else 0)
        return age_ns < 1_000_000_000

    @property
    def ready(self) -> bool:
        """Whether the robot could be armed, and is not."""
        return self.fresh and self.control.state.name == "STANDBY" and not (
            self.control.against_arming
        )  # fmt: skip

    @property
    def speed_m_s(self) -> float:
        """True speed, forwards or not."""
        return abs(self.truth.v_m_s) if self.truth else 0.0

    def drive(self) -> None:
        """Arm the robot and let it drive its mission until it is at speed."""
        self.wait("ready to arm", lambda: self.ready, 60.0)
        self.wait("mode AUTO", lambda: self.command(176, 1, AUTO), 20.0)
        self.wait("armed", lambda: self.command(400, 1), 20.0)
        self.wait("at speed", lambda: self.speed_m_s > 0.3, 20.0)

    def stands(self, within_s: float) -> None:
        """Wait until the wheels stand, and see that they do for a second."""
        self.wait("the wheels stand", lambda: self.speed_m_s < 0.005, within_s)
        place_m = self.truth.distance_m
        until_s = time.monotonic() + 1.0
        self.wait("for a second", lambda: time.monotonic() > until_s, 3.0)
        if self.truth.distance_m - place_m > 0.01:
            raise SceneError(f"it moved on by {self.truth.distance_m - place_m:.3f} m")

    def is_back_disarmed(self, within_s: float) -> None:
        """Wait until control is back; the robot must not have moved meanwhile."""
        place_m = self.truth.distance_m
        self.control = None
        self.wait("back", lambda: self.fresh and self.control.state.name == "STANDBY", within_s)
        if self.truth.distance_m - place_m > 0.01:
            raise SceneError(f"it moved by {self.truth.distance_m - place_m:.3f} m")

    def drives_again(self) -> None:
        """Arm it once more, see it drive a bit, and disarm it."""
        # Where the drive has stopped by itself only a request to arm ends that.
        self.wait("mode HOLD", lambda: self.command(176, 1, HOLD), 20.0)
        self.wait("armed", lambda: self.command(400, 1), 30.0)
        self.wait("disarmed", lambda: self.command(400, 0), 20.0)
        self.drive()
        place_m = self.truth.distance_m
        self.wait("drives again", lambda: self.truth.distance_m - place_m > 0.3, 20.0)
        self.disarm()

    def disarm(self) -> None:
        """Let it stand, disarmed."""
        self.wait("disarmed", lambda: self.command(400, 0), 20.0)
        self.wait("the wheels stand", lambda: self.speed_m_s < 0.005, 5.0)
        if self.truth.unsafe_motions or self.truth.collisions:
            raise SceneError(f"unsafe: {self.truth}")


def expect(told: Callable[[], str], phrase: str, within_s: float = 10.0) -> None:
    """Wait until a phrase is told, and say its line.

    Raises
    ------
    SceneError
        If it is not in time.
    """
    until_s = time.monotonic() + within_s
    while True:
        text = told()
        for line in text.splitlines():
            if phrase in line:
                say(f"said: {line.strip()}")
                return
        if time.monotonic() > until_s:
            raise SceneError(f"nobody said {phrase}:\n{text}")
        time.sleep(0.5)


def can0() -> str:
    """Return what the kernel tells of the CAN link."""
    return ask("ip", "-details", "-statistics", "link", "show", "can0")


def link() -> None:
    """See that the CAN link is as our files say, and that doctor agrees."""
    expect(can0, "can state ERROR-ACTIVE", 30.0)
    firmware = "journalctl", "--boot", "--unit=firmware", "--output=cat"
    expect(lambda: ask(*firmware), "ready", 90.0)
    shown = can0()
    for part in ("bitrate 1000000 ", "sample-point 0.750", "restart-ms 100", "qlen 16"):
        if part not in shown:
            raise SceneError(f"can0 has no {part}:\n{shown}")
    result = subprocess.run(
        ["/opt/robotctl/bin/robotctl", "doctor", "--robot", "/etc/robotctl/robot.toml"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    say(result.stdout)
    # How late a loop wakes up is a matter of a real computer's kernel, not of an emulated one's.
    if any(line.startswith("fail") and "wake-up lag" not in line
           for line in result.stdout.splitlines()):  # fmt: skip
        raise SceneError(f"doctor ended with status {result.returncode}")


def service_started() -> None:
    """See that the service has started by itself and waits to be armed."""
    rig = Rig()
    rig.serves()
    rig.wait("ready to arm", lambda: rig.ready, 60.0)
    say(service()["StatusText"])


def patrol() -> None:
    """Drive some metres of the patrol."""
    rig = Rig()
    rig.drive()
    place_m = rig.truth.distance_m
    rig.wait("three metres on", lambda: rig.truth.distance_m - place_m > 3.0, 30.0)
    state, truth = rig.control, rig.truth
    say(f"truth {truth.x_m:.2f}, {truth.y_m:.2f}; odometry {state.x_m:.2f}, {state.y_m:.2f}")
    say(f"{rig.control.loop}")
    rig.disarm()


def killed() -> None:
    """Kill control while it drives: the wheels stop, and it comes back disarmed."""
    rig = Rig()
    rig.drive()
    since_s = time.time()
    os.kill(process_of("robotctl-control"), signal.SIGKILL)
    rig.stands(1.0)
    rig.is_back_disarmed(60.0)
    expect(lambda: journal(since_s), "control ended")
    rig.drives_again()


def unplugged() -> None:
    """Take the adapter out while it drives, and put it in again."""
    rig = Rig()
    rig.drive()
    since_s = time.time()
    device = Path("/sys/class/net/can0/device").resolve()
    (device / "remove").write_text("1")
    rig.stands(1.0)
    rig.serves(active=False, within_s=30.0)
    expect(lambda: journal(since_s), "stopped: ")
    expect(lambda: journal(since_s), "flight recorder written to")
    Path("/sys/bus/pci/rescan").write_text("1")
    rig.serves()
    rig.is_back_disarmed(60.0)
    rig.drives_again()


def bus_off() -> None:
    """Let the host make the controller go bus-off while it drives."""
    rig = Rig()
    rig.drive()
    since_s, before = time.time(), service()["InvocationID"]
    told = error_frames()
    said = ask("grep", "kvaser_pci_read_reg", "/proc/kallsyms")
    say(f"host: bus off {said.split()[0]}")
    rig.wait("it notices", lambda: rig.control.state.name == "FAULT", 10.0)
    rig.stands(1.0)
    expect(lambda: journal(since_s), "stopped: ")
    say_error_frames(told)
    expect(can0, "can state ERROR-ACTIVE")
    say(" ".join(can0().split()))
    if service()["InvocationID"] != before:
        raise SceneError("the service was started anew")
    rig.drives_again()


def error_frames() -> socket.socket:
    """Return a socket that gets the error frames of can0's driver, and nothing else."""
    told = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    told.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
    told.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, 0x1FFF_FFFF)
    told.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    told.bind(("can0",))
    told.setblocking(False)
    return told


def say_error_frames(told: socket.socket) -> None:
    """Say which error frames there were, and when [s]."""
    first_s = 0.0
    with contextlib.suppress(BlockingIOError):
        while True:
            frame, stamps, _, _ = told.recvmsg(16, 64)
            classes, data = int.from_bytes(frame[:4], "little"), frame[8:]
            at_s = sum(map(mul, struct.unpack("@ll", stamps[0][2]), (1.0, 1e-9)))
            first_s = first_s or at_s
            say(f"error frame {classes:08X} {data.hex(' ')} at {at_s - first_s:.4f} s")


def frozen() -> None:
    """Freeze the supervisor while it drives: systemd's watchdog ends all and starts it anew."""
    rig = Rig()
    rig.drive()
    since_s, before = time.time(), service()
    os.kill(int(before["MainPID"]), signal.SIGSTOP)
    rig.wait(
        "the watchdog bites", lambda: service()["InvocationID"] != before["InvocationID"]
        or service()["ActiveState"] != "active", 20.0, 0.5,
    )  # fmt: skip
    rig.stands(5.0)
    rig.serves()
    expect(lambda: journal(since_s), "Watchdog timeout")
    rig.is_back_disarmed(60.0)
    rig.drives_again()


def before_the_cut() -> None:
    """Drive until the odometer has been saved on the way; then the host cuts the power."""
    rig = Rig()
    rig.drive()
    first = saved_odometer_m()
    rig.wait("saved on the way", lambda: saved_odometer_m() > first + 0.2, 20.0)
    rig.wait("and further", lambda: rig.control.odometer_m > saved_odometer_m() + 0.5, 10.0)
    marks = {"odometer_m": rig.control.odometer_m, "saved_m": saved_odometer_m()}
    say(f"host: cut {json.dumps(marks)}")
    time.sleep(60.0)


def after_the_cut() -> None:
    """See that nothing is lost but the last seconds, and that the odometer goes on."""
    marks = json.loads(sys.argv[2])
    rig = Rig()
    rig.serves()
    rig.wait("ready to arm", lambda: rig.ready, 60.0)
    odometer_m = rig.control.odometer_m
    before = f"odometer {marks['odometer_m']:.2f} m, saved {marks['saved_m']:.2f} m"
    say(f"{before}; now {odometer_m:.2f} m")
    if not marks["saved_m"] - 0.01 <= odometer_m <= marks["odometer_m"] + 0.5:
        raise SceneError("the odometer does not go on")
    for line in Path("/var/log/robotctl/exits.jsonl").read_text().splitlines():
        json.loads(line)
    errors = ask("journalctl", "--boot", "--dmesg", "--grep=EXT4-fs error", "--no-pager")
    if "EXT4-fs error" in errors:
        raise SceneError(errors)
    say(ask("ls", "-l", "/var/log/robotctl", "/var/lib/robotctl"))
    rig.drives_again()
    if rig.control.odometer_m < odometer_m + 0.3:
        raise SceneError(f"the odometer stands at {rig.control.odometer_m:.2f} m")


def saved_odometer_m() -> float:
    """Return the odometer on the disk [m]; 0: none yet."""
    if not PROGRESS.exists():
        return 0.0
    return float(json.loads(PROGRESS.read_text().split("\n", 1)[1])["odometer_m"])


if __name__ == "__main__":
    try:
        globals()[sys.argv[1]]()
    except SceneError as error:
        say(str(error))
        sys.exit(1)
