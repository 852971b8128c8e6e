"""Public names of the package; importing one loads its module only."""

from .formats.recorded_log import LOG_FORMATS as LOG_FORMATS
from .formats.recorded_log import read_recording as read_recording
from .formats.recorded_log import read_reference as read_reference
from .formats.tum import write_tum as write_tum
from .mcap.log import McapLog as McapLog
