"""Public names of the package; importing one loads its module only."""

from .clock import RealClock as RealClock
from .clock import VirtualClock as VirtualClock
from .flight.recorder import read_record as read_record
from .flight.ring import FlightRing as FlightRing
from .ipc.topics import Endpoints as Endpoints
from .ipc.topics import RequestSender as RequestSender
from .ipc.topics import Subscriber as Subscriber
from .loop import Loop as Loop
from .storage.log_folder import LogFolder as LogFolder
from .storage.state_file import StateFile as StateFile
