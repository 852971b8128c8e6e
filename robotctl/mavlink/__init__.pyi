"""Public names of the package; importing one loads its module only."""

from .catalogue import Stream as Stream
from .command import Command as Command
from .config import MavlinkConfig as MavlinkConfig
from .context import TelemetryRobot as TelemetryRobot
from .service import Microservice as Microservice
from .services.registry import SERVICES as SERVICES
from .telemetry import Telemetry as Telemetry
