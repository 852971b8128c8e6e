"""Real-time controller for wheeled robots: CAN motor control, MAVLink and on-board estimation."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str
else:

    def __getattr__(name: str) -> str:
        """Return `__version__`; to read it takes longer than the start of most commands."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import version  # noqa: PLC0415

        globals()[name] = found = version("robotctl")
        return found
