"""Process 1 of the guest of `tools/vcan-guest`: mounts, vcan0, the command, power off.

Needs nothing but Python: no mount, no ip, no init system.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import sys
import termios
import threading
import traceback
import tty
from pathlib import Path
from typing import Any

from can_link import add_vcan, set_link

COMMAND_NOT_FOUND = 127
NOT_EXECUTABLE = 126
_MOUNTS = (
    ("proc", "/proc", "proc"),
    ("sysfs", "/sys", "sysfs"),
    ("devtmpfs", "/dev", "devtmpfs"),
    ("devpts", "/dev/pts", "devpts"),
    ("tmpfs", "/dev/shm", "tmpfs"),
    ("tmpfs", "/run", "tmpfs"),
)
_LINKS = {"fd": "self/fd", "stdin": "self/fd/0", "stdout": "self/fd/1", "stderr": "self/fd/2"}
# The consoles that the host side connects to its standard output and standard error.
_OUTPUT_CONSOLES = ("/dev/tty1", "/dev/tty2")
_POWER_OFF = 0x4321FEDC
_BIND = 0x1000
_PROCESSOR = "/proc/cpuinfo"


def mount_all(libc: ctypes.CDLL) -> None:
    """Give the guest its own kernel interfaces and its own place for sockets."""
    for source, target, kind in _MOUNTS:
        Path(target).mkdir(exist_ok=True)
        if libc.mount(source.encode(), target.encode(), kind.encode(), 0, None) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise OSError(f"mounting {kind} on {target}: {reason}")
    for name, target in _LINKS.items():
        if not Path("/dev", name).exists():
            Path("/dev", name).symlink_to(f"/proc/{target}")


def tell_processor(libc: ctypes.CDLL, folder: Path) -> None:
    """Let the guest call its processor what the host does, which it is.

    By that, a program finds code that was compiled for it: else each process that has inner loops
    would load numba instead of a library.
    """
    source = str(folder / "cpuinfo").encode()
    if libc.mount(source, _PROCESSOR.encode(), None, _BIND, None) != 0:
        raise OSError(f"{_PROCESSOR}: {os.strerror(ctypes.get_errno())}")


def let_real_time_run() -> None:
    """Switch off the throttling of real-time processes, which is wrong under virtual time.

    This kernel counts their time in whole ticks of 10 ms. A process that works for some
    microseconds whenever a tick passes would count as one that never rests, and be held up for
    50 ms each second. With --real-time the throttle stays: it keeps a process that spins from
    taking the guest with it, which under virtual time just makes time stand still.
    """
    Path("/proc/sys/kernel/sched_rt_runtime_us").write_text("-1")


class Output:
    """Carries one output of the command to the host, byte by byte as it is.

    The command writes to a pipe, not to the console itself: a console would be a terminal to it.
    """

    def __init__(self, console: str) -> None:
        self._console = os.open(console, os.O_WRONLY | os.O_NOCTTY)
        tty.setraw(self._console)
        self._pipe, self.command_end = os.pipe()
        self._thread = threading.Thread(target=self._carry, daemon=True)

    def start(self) -> None:
        """Carry from now on; the command has its end of the pipe."""
        os.close(self.command_end)
        self._thread.start()

    def finish(self) -> None:
        """Wait until the host has it all; nobody must be left who could still write."""
        self._thread.join()
        termios.tcdrain(self._console)

    def _carry(self) -> None:
        while chunk := os.read(self._pipe, 65536):
            while chunk:
                chunk = chunk[os.write(self._console, chunk) :]


def start(order: dict[str, Any], stdout: Output, stderr: Output) -> int:
    """Start the command as a child with its own session and return its process id."""
    environment = dict(order["environment"])
    for name in ("runtime", "tmp"):
        Path("/run", name).mkdir(mode=0o700)
    environment |= {"XDG_RUNTIME_DIR": "/run/runtime", "TMPDIR": "/run/tmp"}
    command = order["command"]
    child = os.fork()
    if child:
        return child
    os.setsid()
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(stdout.command_end, 1)
    os.dup2(stderr.command_end, 2)
    # What Python ignores in this process, the command shall not.
    signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    status = NOT_EXECUTABLE
    try:
        os.chdir(order["directory"])
        os.execvpe(command[0], command, environment)
    except FileNotFoundError as error:
        status = COMMAND_NOT_FOUND
        reason = error.strerror
    except OSError as error:
        reason = error.strerror
    os.write(2, f"vcan-guest: {command[0]}: {reason}\n".encode())
    os._exit(status)


def run(order: dict[str, Any]) -> int:
    """Run the command, bury orphans meanwhile, end what it left behind; return its status."""
    outputs = [Output(console) for console in _OUTPUT_CONSOLES]
    child = start(order, *outputs)
    for output in outputs:
        output.start()
    pid, status = os.wait()
    while pid != child:
        pid, status = os.wait()
    with contextlib.suppress(ProcessLookupError):
        os.kill(-1, signal.SIGKILL)
    for output in outputs:
        output.finish()
    code = os.waitstatus_to_exitcode(status)
    return code if code >= 0 else 128 - code


def main() -> None:
    """Do all of it and switch the guest off, whatever happens."""
    folder = Path(sys.argv[1])
    libc = ctypes.CDLL(None, use_errno=True)
    try:
        order = json.loads((folder / "order.json").read_text())
        mount_all(libc)
        tell_processor(libc, folder)
        if order["environment"]["VCAN_GUEST"] == "virtual":
            let_real_time_run()
        set_link("lo", up=True)
        add_vcan("vcan0")
        set_link("vcan0", up=True)
        status = run(order)
        (folder / "status").write_text(str(status))
    except BaseException:  # noqa: BLE001 - process 1 must reach the power switch
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os.sync()
    libc.reboot(_POWER_OFF)


if __name__ == "__main__":
    main()
