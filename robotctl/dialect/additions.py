"""Messages of robotctl's dialect that pymavlink's `common` lacks.

Written by tools/write_dialect.py from robotctl.xml: change that, and run it.
"""

import struct
from typing import Dict, Sequence, Union

from pymavlink.dialects.v20.common import MAVLink_message, mavlink_msg_deprecated_name_property

ESC_CONNECTION_TYPE_CAN = 4
ESC_FAILURE_OVER_CURRENT = 1
ESC_FAILURE_OVER_VOLTAGE = 2
ESC_FAILURE_OVER_TEMPERATURE = 4
ESC_FAILURE_GENERIC = 64
MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET = 1
MAV_EVENT_ERROR_REASON_UNAVAILABLE = 0
MAV_PARAM_ERROR_TYPE_UNSUPPORTED = 6
MAV_PARAM_ERROR_TYPE_MISMATCH = 7
MAV_RESULT_CANCELLED = 6
MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME = 9

MAVLINK_MSG_ID_COMMAND_CANCEL = 80
MAVLINK_MSG_ID_EKF_STATUS_REPORT = 193
MAVLINK_MSG_ID_ESC_INFO = 290
MAVLINK_MSG_ID_ESC_STATUS = 291
MAVLINK_MSG_ID_PROTOCOL_VERSION = 300
MAVLINK_MSG_ID_BATTERY_INFO = 372
MAVLINK_MSG_ID_COMPONENT_METADATA = 397
MAVLINK_MSG_ID_EVENT = 410
MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE = 411
MAVLINK_MSG_ID_REQUEST_EVENT = 412
MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR = 413
MAVLINK_MSG_ID_AVAILABLE_MODES = 435
MAVLINK_MSG_ID_CURRENT_MODE = 436
MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR = 437


class MAVLink_command_cancel_message(MAVLink_message):
    """
    Ends a command that takes long.
    """

    id = MAVLINK_MSG_ID_COMMAND_CANCEL
    msgname = "COMMAND_CANCEL"
    fieldnames = ["target_system", "target_component", "command"]
    ordered_fieldnames = ["command", "target_system", "target_component"]
    fieldtypes = ["uint8_t", "uint8_t", "uint16_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"command": "MAV_CMD"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<HBB")
    orders = [1, 2, 0]
    lengths = [1, 1, 1]
    array_lengths = [0, 0, 0]
    crc_extra = 14
    unpacker = struct.Struct("<HBB")
    instance_field = None
    instance_offset = -1

    def __init__(self, target_system: int, target_component: int, command: int):
        MAVLink_message.__init__(self, MAVLink_command_cancel_message.id, MAVLink_command_cancel_message.msgname)
        self._fieldnames = MAVLink_command_cancel_message.fieldnames
        self._instance_field = MAVLink_command_cancel_message.instance_field
        self._instance_offset = MAVLink_command_cancel_message.instance_offset
        self.target_system = target_system
        self.target_component = target_component
        self.command = command

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.command, self.target_system, self.target_component), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_command_cancel_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_ekf_status_report_message(MAVLink_message):
    """
    EKF Status message including flags and variances.
    """

    id = MAVLINK_MSG_ID_EKF_STATUS_REPORT
    msgname = "EKF_STATUS_REPORT"
    fieldnames = ["flags", "velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "terrain_alt_variance", "airspeed_variance"]
    ordered_fieldnames = ["velocity_variance", "pos_horiz_variance", "pos_vert_variance", "compass_variance", "terrain_alt_variance", "flags", "airspeed_variance"]
    fieldtypes = ["uint16_t", "float", "float", "float", "float", "float", "float"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"flags": "EKF_STATUS_FLAGS"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<fffffHf")
    orders = [5, 0, 1, 2, 3, 4, 6]
    lengths = [1, 1, 1, 1, 1, 1, 1]
    array_lengths = [0, 0, 0, 0, 0, 0, 0]
    crc_extra = 71
    unpacker = struct.Struct("<fffffHf")
    instance_field = None
    instance_offset = -1

    def __init__(self, flags: int, velocity_variance: float, pos_horiz_variance: float, pos_vert_variance: float, compass_variance: float, terrain_alt_variance: float, airspeed_variance: float = 0):
        MAVLink_message.__init__(self, MAVLink_ekf_status_report_message.id, MAVLink_ekf_status_report_message.msgname)
        self._fieldnames = MAVLink_ekf_status_report_message.fieldnames
        self._instance_field = MAVLink_ekf_status_report_message.instance_field
        self._instance_offset = MAVLink_ekf_status_report_message.instance_offset
        self.flags = flags
        self.velocity_variance = velocity_variance
        self.pos_horiz_variance = pos_horiz_variance
        self.pos_vert_variance = pos_vert_variance
        self.compass_variance = compass_variance
        self.terrain_alt_variance = terrain_alt_variance
        self.airspeed_variance = airspeed_variance

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.velocity_variance, self.pos_horiz_variance, self.pos_vert_variance, self.compass_variance, self.terrain_alt_variance, self.flags, self.airspeed_variance), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_ekf_status_report_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_esc_info_message(MAVLink_message):
    """
    State of up to four motor controllers.
    """

    id = MAVLINK_MSG_ID_ESC_INFO
    msgname = "ESC_INFO"
    fieldnames = ["index", "time_usec", "counter", "count", "connection_type", "info", "failure_flags", "error_count", "temperature"]
    ordered_fieldnames = ["time_usec", "error_count", "counter", "failure_flags", "temperature", "index", "count", "connection_type", "info"]
    fieldtypes = ["uint8_t", "uint64_t", "uint16_t", "uint8_t", "uint8_t", "uint8_t", "uint16_t", "uint32_t", "int16_t"]
    fielddisplays_by_name: Dict[str, str] = {"info": "bitmask"}
    fieldenums_by_name: Dict[str, str] = {"connection_type": "ESC_CONNECTION_TYPE", "failure_flags": "ESC_FAILURE_FLAGS"}
    fieldunits_by_name: Dict[str, str] = {"time_usec": "us", "temperature": "cdegC"}
    native_format = bytearray(b"<QIHHhBBBB")
    orders = [5, 0, 2, 6, 7, 8, 3, 1, 4]
    lengths = [1, 4, 1, 4, 4, 1, 1, 1, 1]
    array_lengths = [0, 4, 0, 4, 4, 0, 0, 0, 0]
    crc_extra = 251
    unpacker = struct.Struct("<Q4IH4H4hBBBB")
    instance_field = "index"
    instance_offset = 42

    def __init__(self, index: int, time_usec: int, counter: int, count: int, connection_type: int, info: int, failure_flags: Sequence[int], error_count: Sequence[int], temperature: Sequence[int]):
        MAVLink_message.__init__(self, MAVLink_esc_info_message.id, MAVLink_esc_info_message.msgname)
        self._fieldnames = MAVLink_esc_info_message.fieldnames
        self._instance_field = MAVLink_esc_info_message.instance_field
        self._instance_offset = MAVLink_esc_info_message.instance_offset
        self.index = index
        self.time_usec = time_usec
        self.counter = counter
        self.count = count
        self.connection_type = connection_type
        self.info = info
        self.failure_flags = failure_flags
        self.error_count = error_count
        self.temperature = temperature

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.time_usec, self.error_count[0], self.error_count[1], self.error_count[2], self.error_count[3], self.counter, self.failure_flags[0], self.failure_flags[1], self.failure_flags[2], self.failure_flags[3], self.temperature[0], self.temperature[1], self.temperature[2], self.temperature[3], self.index, self.count, self.connection_type, self.info), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_esc_info_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_esc_status_message(MAVLink_message):
    """
    What up to four motor controllers measure.
    """

    id = MAVLINK_MSG_ID_ESC_STATUS
    msgname = "ESC_STATUS"
    fieldnames = ["index", "time_usec", "rpm", "voltage", "current"]
    ordered_fieldnames = ["time_usec", "rpm", "voltage", "current", "index"]
    fieldtypes = ["uint8_t", "uint64_t", "int32_t", "float", "float"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {"time_usec": "us", "rpm": "rpm", "voltage": "V", "current": "A"}
    native_format = bytearray(b"<QiffB")
    orders = [4, 0, 1, 2, 3]
    lengths = [1, 4, 4, 4, 1]
    array_lengths = [0, 4, 4, 4, 0]
    crc_extra = 10
    unpacker = struct.Struct("<Q4i4f4fB")
    instance_field = "index"
    instance_offset = 56

    def __init__(self, index: int, time_usec: int, rpm: Sequence[int], voltage: Sequence[float], current: Sequence[float]):
        MAVLink_message.__init__(self, MAVLink_esc_status_message.id, MAVLink_esc_status_message.msgname)
        self._fieldnames = MAVLink_esc_status_message.fieldnames
        self._instance_field = MAVLink_esc_status_message.instance_field
        self._instance_offset = MAVLink_esc_status_message.instance_offset
        self.index = index
        self.time_usec = time_usec
        self.rpm = rpm
        self.voltage = voltage
        self.current = current

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.time_usec, self.rpm[0], self.rpm[1], self.rpm[2], self.rpm[3], self.voltage[0], self.voltage[1], self.voltage[2], self.voltage[3], self.current[0], self.current[1], self.current[2], self.current[3], self.index), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_esc_status_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_protocol_version_message(MAVLink_message):
    """
    Versions of MAVLink, 100 for 1.0.
    """

    id = MAVLINK_MSG_ID_PROTOCOL_VERSION
    msgname = "PROTOCOL_VERSION"
    fieldnames = ["version", "min_version", "max_version", "spec_version_hash", "library_version_hash"]
    ordered_fieldnames = ["version", "min_version", "max_version", "spec_version_hash", "library_version_hash"]
    fieldtypes = ["uint16_t", "uint16_t", "uint16_t", "uint8_t", "uint8_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<HHHBB")
    orders = [0, 1, 2, 3, 4]
    lengths = [1, 1, 1, 8, 8]
    array_lengths = [0, 0, 0, 8, 8]
    crc_extra = 217
    unpacker = struct.Struct("<HHH8B8B")
    instance_field = None
    instance_offset = -1

    def __init__(self, version: int, min_version: int, max_version: int, spec_version_hash: Sequence[int], library_version_hash: Sequence[int]):
        MAVLink_message.__init__(self, MAVLink_protocol_version_message.id, MAVLink_protocol_version_message.msgname)
        self._fieldnames = MAVLink_protocol_version_message.fieldnames
        self._instance_field = MAVLink_protocol_version_message.instance_field
        self._instance_offset = MAVLink_protocol_version_message.instance_offset
        self.version = version
        self.min_version = min_version
        self.max_version = max_version
        self.spec_version_hash = spec_version_hash
        self.library_version_hash = library_version_hash

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.version, self.min_version, self.max_version, self.spec_version_hash[0], self.spec_version_hash[1], self.spec_version_hash[2], self.spec_version_hash[3], self.spec_version_hash[4], self.spec_version_hash[5], self.spec_version_hash[6], self.spec_version_hash[7], self.library_version_hash[0], self.library_version_hash[1], self.library_version_hash[2], self.library_version_hash[3], self.library_version_hash[4], self.library_version_hash[5], self.library_version_hash[6], self.library_version_hash[7]), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_protocol_version_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_battery_info_message(MAVLink_message):
    """
    What a battery is.
    """

    id = MAVLINK_MSG_ID_BATTERY_INFO
    msgname = "BATTERY_INFO"
    fieldnames = ["id", "battery_function", "type", "state_of_health", "cells_in_series", "cycle_count", "weight", "discharge_minimum_voltage", "charging_minimum_voltage", "resting_minimum_voltage", "charging_maximum_voltage", "charging_maximum_current", "nominal_voltage", "discharge_maximum_current", "discharge_maximum_burst_current", "design_capacity", "full_charge_capacity", "manufacture_date", "serial_number", "name"]
    ordered_fieldnames = ["discharge_minimum_voltage", "charging_minimum_voltage", "resting_minimum_voltage", "charging_maximum_voltage", "charging_maximum_current", "nominal_voltage", "discharge_maximum_current", "discharge_maximum_burst_current", "design_capacity", "full_charge_capacity", "cycle_count", "weight", "id", "battery_function", "type", "state_of_health", "cells_in_series", "manufacture_date", "serial_number", "name"]
    fieldtypes = ["uint8_t", "uint8_t", "uint8_t", "uint8_t", "uint8_t", "uint16_t", "uint16_t", "float", "float", "float", "float", "float", "float", "float", "float", "float", "float", "char", "char", "char"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"battery_function": "MAV_BATTERY_FUNCTION", "type": "MAV_BATTERY_TYPE"}
    fieldunits_by_name: Dict[str, str] = {"state_of_health": "%", "weight": "g", "discharge_minimum_voltage": "V", "charging_minimum_voltage": "V", "resting_minimum_voltage": "V", "charging_maximum_voltage": "V", "charging_maximum_current": "A", "nominal_voltage": "V", "discharge_maximum_current": "A", "discharge_maximum_burst_current": "A", "design_capacity": "Ah", "full_charge_capacity": "Ah"}
    native_format = bytearray(b"<ffffffffffHHBBBBBccc")
    orders = [12, 13, 14, 15, 16, 10, 11, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 17, 18, 19]
    lengths = [1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1]
    array_lengths = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 9, 32, 50]
    crc_extra = 26
    unpacker = struct.Struct("<ffffffffffHHBBBBB9s32s50s")
    instance_field = "id"
    instance_offset = 44

    def __init__(self, id: int, battery_function: int, type: int, state_of_health: int, cells_in_series: int, cycle_count: int, weight: int, discharge_minimum_voltage: float, charging_minimum_voltage: float, resting_minimum_voltage: float, charging_maximum_voltage: float, charging_maximum_current: float, nominal_voltage: float, discharge_maximum_current: float, discharge_maximum_burst_current: float, design_capacity: float, full_charge_capacity: float, manufacture_date: bytes, serial_number: bytes, name: bytes):
        MAVLink_message.__init__(self, MAVLink_battery_info_message.id, MAVLink_battery_info_message.msgname)
        self._fieldnames = MAVLink_battery_info_message.fieldnames
        self._instance_field = MAVLink_battery_info_message.instance_field
        self._instance_offset = MAVLink_battery_info_message.instance_offset
        self.id = id
        self.battery_function = battery_function
        self.type = type
        self.state_of_health = state_of_health
        self.cells_in_series = cells_in_series
        self.cycle_count = cycle_count
        self.weight = weight
        self.discharge_minimum_voltage = discharge_minimum_voltage
        self.charging_minimum_voltage = charging_minimum_voltage
        self.resting_minimum_voltage = resting_minimum_voltage
        self.charging_maximum_voltage = charging_maximum_voltage
        self.charging_maximum_current = charging_maximum_current
        self.nominal_voltage = nominal_voltage
        self.discharge_maximum_current = discharge_maximum_current
        self.discharge_maximum_burst_current = discharge_maximum_burst_current
        self.design_capacity = design_capacity
        self.full_charge_capacity = full_charge_capacity
        self._manufacture_date_raw = manufacture_date
        self.manufacture_date = manufacture_date.split(b"\x00", 1)[0].decode("ascii", errors="replace")
        self._serial_number_raw = serial_number
        self.serial_number = serial_number.split(b"\x00", 1)[0].decode("ascii", errors="replace")
        self._name_raw = name
        self.name = name.split(b"\x00", 1)[0].decode("ascii", errors="replace")

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.discharge_minimum_voltage, self.charging_minimum_voltage, self.resting_minimum_voltage, self.charging_maximum_voltage, self.charging_maximum_current, self.nominal_voltage, self.discharge_maximum_current, self.discharge_maximum_burst_current, self.design_capacity, self.full_charge_capacity, self.cycle_count, self.weight, self.id, self.battery_function, self.type, self.state_of_health, self.cells_in_series, self._manufacture_date_raw, self._serial_number_raw, self._name_raw), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_battery_info_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_component_metadata_message(MAVLink_message):
    """
    Where the general metadata file lies.
    """

    id = MAVLINK_MSG_ID_COMPONENT_METADATA
    msgname = "COMPONENT_METADATA"
    fieldnames = ["time_boot_ms", "file_crc", "uri"]
    ordered_fieldnames = ["time_boot_ms", "file_crc", "uri"]
    fieldtypes = ["uint32_t", "uint32_t", "char"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {"time_boot_ms": "ms"}
    native_format = bytearray(b"<IIc")
    orders = [0, 1, 2]
    lengths = [1, 1, 1]
    array_lengths = [0, 0, 100]
    crc_extra = 182
    unpacker = struct.Struct("<II100s")
    instance_field = None
    instance_offset = -1

    def __init__(self, time_boot_ms: int, file_crc: int, uri: bytes):
        MAVLink_message.__init__(self, MAVLink_component_metadata_message.id, MAVLink_component_metadata_message.msgname)
        self._fieldnames = MAVLink_component_metadata_message.fieldnames
        self._instance_field = MAVLink_component_metadata_message.instance_field
        self._instance_offset = MAVLink_component_metadata_message.instance_offset
        self.time_boot_ms = time_boot_ms
        self.file_crc = file_crc
        self._uri_raw = uri
        self.uri = uri.split(b"\x00", 1)[0].decode("ascii", errors="replace")

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.time_boot_ms, self.file_crc, self._uri_raw), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_component_metadata_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_event_message(MAVLink_message):
    """
    Something has happened; metadata says what the number means.
    """

    id = MAVLINK_MSG_ID_EVENT
    msgname = "EVENT"
    fieldnames = ["destination_component", "destination_system", "id", "event_time_boot_ms", "sequence", "log_levels", "arguments"]
    ordered_fieldnames = ["id", "event_time_boot_ms", "sequence", "destination_component", "destination_system", "log_levels", "arguments"]
    fieldtypes = ["uint8_t", "uint8_t", "uint32_t", "uint32_t", "uint16_t", "uint8_t", "uint8_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {"event_time_boot_ms": "ms"}
    native_format = bytearray(b"<IIHBBBB")
    orders = [3, 4, 0, 1, 2, 5, 6]
    lengths = [1, 1, 1, 1, 1, 1, 40]
    array_lengths = [0, 0, 0, 0, 0, 0, 40]
    crc_extra = 160
    unpacker = struct.Struct("<IIHBBB40B")
    instance_field = None
    instance_offset = -1

    def __init__(self, destination_component: int, destination_system: int, id: int, event_time_boot_ms: int, sequence: int, log_levels: int, arguments: Sequence[int]):
        MAVLink_message.__init__(self, MAVLink_event_message.id, MAVLink_event_message.msgname)
        self._fieldnames = MAVLink_event_message.fieldnames
        self._instance_field = MAVLink_event_message.instance_field
        self._instance_offset = MAVLink_event_message.instance_offset
        self.destination_component = destination_component
        self.destination_system = destination_system
        self.id = id
        self.event_time_boot_ms = event_time_boot_ms
        self.sequence = sequence
        self.log_levels = log_levels
        self.arguments = arguments

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.id, self.event_time_boot_ms, self.sequence, self.destination_component, self.destination_system, self.log_levels, self.arguments[0], self.arguments[1], self.arguments[2], self.arguments[3], self.arguments[4], self.arguments[5], self.arguments[6], self.arguments[7], self.arguments[8], self.arguments[9], self.arguments[10], self.arguments[11], self.arguments[12], self.arguments[13], self.arguments[14], self.arguments[15], self.arguments[16], self.arguments[17], self.arguments[18], self.arguments[19], self.arguments[20], self.arguments[21], self.arguments[22], self.arguments[23], self.arguments[24], self.arguments[25], self.arguments[26], self.arguments[27], self.arguments[28], self.arguments[29], self.arguments[30], self.arguments[31], self.arguments[32], self.arguments[33], self.arguments[34], self.arguments[35], self.arguments[36], self.arguments[37], self.arguments[38], self.arguments[39]), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_event_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_current_event_sequence_message(MAVLink_message):
    """
    Number of the last event.
    """

    id = MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE
    msgname = "CURRENT_EVENT_SEQUENCE"
    fieldnames = ["sequence", "flags"]
    ordered_fieldnames = ["sequence", "flags"]
    fieldtypes = ["uint16_t", "uint8_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"flags": "MAV_EVENT_CURRENT_SEQUENCE_FLAGS"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<HB")
    orders = [0, 1]
    lengths = [1, 1]
    array_lengths = [0, 0]
    crc_extra = 106
    unpacker = struct.Struct("<HB")
    instance_field = None
    instance_offset = -1

    def __init__(self, sequence: int, flags: int):
        MAVLink_message.__init__(self, MAVLink_current_event_sequence_message.id, MAVLink_current_event_sequence_message.msgname)
        self._fieldnames = MAVLink_current_event_sequence_message.fieldnames
        self._instance_field = MAVLink_current_event_sequence_message.instance_field
        self._instance_offset = MAVLink_current_event_sequence_message.instance_offset
        self.sequence = sequence
        self.flags = flags

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.sequence, self.flags), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_current_event_sequence_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_request_event_message(MAVLink_message):
    """
    Asks for events that were missed.
    """

    id = MAVLINK_MSG_ID_REQUEST_EVENT
    msgname = "REQUEST_EVENT"
    fieldnames = ["target_system", "target_component", "first_sequence", "last_sequence"]
    ordered_fieldnames = ["first_sequence", "last_sequence", "target_system", "target_component"]
    fieldtypes = ["uint8_t", "uint8_t", "uint16_t", "uint16_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<HHBB")
    orders = [2, 3, 0, 1]
    lengths = [1, 1, 1, 1]
    array_lengths = [0, 0, 0, 0]
    crc_extra = 33
    unpacker = struct.Struct("<HHBB")
    instance_field = None
    instance_offset = -1

    def __init__(self, target_system: int, target_component: int, first_sequence: int, last_sequence: int):
        MAVLink_message.__init__(self, MAVLink_request_event_message.id, MAVLink_request_event_message.msgname)
        self._fieldnames = MAVLink_request_event_message.fieldnames
        self._instance_field = MAVLink_request_event_message.instance_field
        self._instance_offset = MAVLink_request_event_message.instance_offset
        self.target_system = target_system
        self.target_component = target_component
        self.first_sequence = first_sequence
        self.last_sequence = last_sequence

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.first_sequence, self.last_sequence, self.target_system, self.target_component), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_request_event_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_response_event_error_message(MAVLink_message):
    """
    An event cannot be sent again.
    """

    id = MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR
    msgname = "RESPONSE_EVENT_ERROR"
    fieldnames = ["target_system", "target_component", "sequence", "sequence_oldest_available", "reason"]
    ordered_fieldnames = ["sequence", "sequence_oldest_available", "target_system", "target_component", "reason"]
    fieldtypes = ["uint8_t", "uint8_t", "uint16_t", "uint16_t", "uint8_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"reason": "MAV_EVENT_ERROR_REASON"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<HHBBB")
    orders = [2, 3, 0, 1, 4]
    lengths = [1, 1, 1, 1, 1]
    array_lengths = [0, 0, 0, 0, 0]
    crc_extra = 77
    unpacker = struct.Struct("<HHBBB")
    instance_field = None
    instance_offset = -1

    def __init__(self, target_system: int, target_component: int, sequence: int, sequence_oldest_available: int, reason: int):
        MAVLink_message.__init__(self, MAVLink_response_event_error_message.id, MAVLink_response_event_error_message.msgname)
        self._fieldnames = MAVLink_response_event_error_message.fieldnames
        self._instance_field = MAVLink_response_event_error_message.instance_field
        self._instance_offset = MAVLink_response_event_error_message.instance_offset
        self.target_system = target_system
        self.target_component = target_component
        self.sequence = sequence
        self.sequence_oldest_available = sequence_oldest_available
        self.reason = reason

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.sequence, self.sequence_oldest_available, self.target_system, self.target_component, self.reason), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_response_event_error_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_available_modes_message(MAVLink_message):
    """
    Get information about a particular flight modes.         The
    message can be enumerated or requested for a particular mode using
    MAV_CMD_REQUEST_MESSAGE.         Specify 0 in param2 to request
    that the message is emitted for all available modes or the
    specific index for just one mode.         The modes must be
    available/settable for the current vehicle/frame type.
    Each modes should only be emitted once (even if it is both
    standard and custom).
    """

    id = MAVLINK_MSG_ID_AVAILABLE_MODES
    msgname = "AVAILABLE_MODES"
    fieldnames = ["number_modes", "mode_index", "standard_mode", "custom_mode", "properties", "mode_name"]
    ordered_fieldnames = ["custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name"]
    fieldtypes = ["uint8_t", "uint8_t", "uint8_t", "uint32_t", "uint32_t", "char"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"standard_mode": "MAV_STANDARD_MODE", "properties": "MAV_MODE_PROPERTY"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<IIBBBc")
    orders = [2, 3, 4, 0, 1, 5]
    lengths = [1, 1, 1, 1, 1, 1]
    array_lengths = [0, 0, 0, 0, 0, 35]
    crc_extra = 134
    unpacker = struct.Struct("<IIBBB35s")
    instance_field = None
    instance_offset = -1

    def __init__(self, number_modes: int, mode_index: int, standard_mode: int, custom_mode: int, properties: int, mode_name: bytes):
        MAVLink_message.__init__(self, MAVLink_available_modes_message.id, MAVLink_available_modes_message.msgname)
        self._fieldnames = MAVLink_available_modes_message.fieldnames
        self._instance_field = MAVLink_available_modes_message.instance_field
        self._instance_offset = MAVLink_available_modes_message.instance_offset
        self.number_modes = number_modes
        self.mode_index = mode_index
        self.standard_mode = standard_mode
        self.custom_mode = custom_mode
        self.properties = properties
        self._mode_name_raw = mode_name
        self.mode_name = mode_name.split(b"\x00", 1)[0].decode("ascii", errors="replace")

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.custom_mode, self.properties, self.number_modes, self.mode_index, self.standard_mode, self._mode_name_raw), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_available_modes_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_current_mode_message(MAVLink_message):
    """
    Get the current mode.         This should be emitted on any mode
    change, and broadcast at low rate (nominally 0.5 Hz).         It
    may be requested using MAV_CMD_REQUEST_MESSAGE.
    """

    id = MAVLINK_MSG_ID_CURRENT_MODE
    msgname = "CURRENT_MODE"
    fieldnames = ["standard_mode", "custom_mode", "intended_custom_mode"]
    ordered_fieldnames = ["custom_mode", "intended_custom_mode", "standard_mode"]
    fieldtypes = ["uint8_t", "uint32_t", "uint32_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {"standard_mode": "MAV_STANDARD_MODE"}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<IIB")
    orders = [2, 0, 1]
    lengths = [1, 1, 1]
    array_lengths = [0, 0, 0]
    crc_extra = 193
    unpacker = struct.Struct("<IIB")
    instance_field = None
    instance_offset = -1

    def __init__(self, standard_mode: int, custom_mode: int, intended_custom_mode: int):
        MAVLink_message.__init__(self, MAVLink_current_mode_message.id, MAVLink_current_mode_message.msgname)
        self._fieldnames = MAVLink_current_mode_message.fieldnames
        self._instance_field = MAVLink_current_mode_message.instance_field
        self._instance_offset = MAVLink_current_mode_message.instance_offset
        self.standard_mode = standard_mode
        self.custom_mode = custom_mode
        self.intended_custom_mode = intended_custom_mode

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.custom_mode, self.intended_custom_mode, self.standard_mode), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_current_mode_message, "name", mavlink_msg_deprecated_name_property())


class MAVLink_available_modes_monitor_message(MAVLink_message):
    """
    A change to the sequence number indicates that the set of
    AVAILABLE_MODES has changed.         A receiver must re-request
    all available modes whenever the sequence number changes.
    This is only emitted after the first change and should then be
    broadcast at low rate (nominally 0.3 Hz) and on change.
    """

    id = MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR
    msgname = "AVAILABLE_MODES_MONITOR"
    fieldnames = ["seq"]
    ordered_fieldnames = ["seq"]
    fieldtypes = ["uint8_t"]
    fielddisplays_by_name: Dict[str, str] = {}
    fieldenums_by_name: Dict[str, str] = {}
    fieldunits_by_name: Dict[str, str] = {}
    native_format = bytearray(b"<B")
    orders = [0]
    lengths = [1]
    array_lengths = [0]
    crc_extra = 30
    unpacker = struct.Struct("<B")
    instance_field = None
    instance_offset = -1

    def __init__(self, seq: int):
        MAVLink_message.__init__(self, MAVLink_available_modes_monitor_message.id, MAVLink_available_modes_monitor_message.msgname)
        self._fieldnames = MAVLink_available_modes_monitor_message.fieldnames
        self._instance_field = MAVLink_available_modes_monitor_message.instance_field
        self._instance_offset = MAVLink_available_modes_monitor_message.instance_offset
        self.seq = seq

    def pack(self, mav: "MAVLink", force_mavlink1: bool = False) -> bytes:
        return self._pack(mav, self.crc_extra, self.unpacker.pack(self.seq), force_mavlink1=force_mavlink1)


# Define name on the class for backwards compatibility (it is now msgname).
# Done with setattr to hide the class variable from mypy.
setattr(MAVLink_available_modes_monitor_message, "name", mavlink_msg_deprecated_name_property())


MESSAGES = {
    MAVLINK_MSG_ID_COMMAND_CANCEL: MAVLink_command_cancel_message,
    MAVLINK_MSG_ID_EKF_STATUS_REPORT: MAVLink_ekf_status_report_message,
    MAVLINK_MSG_ID_ESC_INFO: MAVLink_esc_info_message,
    MAVLINK_MSG_ID_ESC_STATUS: MAVLink_esc_status_message,
    MAVLINK_MSG_ID_PROTOCOL_VERSION: MAVLink_protocol_version_message,
    MAVLINK_MSG_ID_BATTERY_INFO: MAVLink_battery_info_message,
    MAVLINK_MSG_ID_COMPONENT_METADATA: MAVLink_component_metadata_message,
    MAVLINK_MSG_ID_EVENT: MAVLink_event_message,
    MAVLINK_MSG_ID_CURRENT_EVENT_SEQUENCE: MAVLink_current_event_sequence_message,
    MAVLINK_MSG_ID_REQUEST_EVENT: MAVLink_request_event_message,
    MAVLINK_MSG_ID_RESPONSE_EVENT_ERROR: MAVLink_response_event_error_message,
    MAVLINK_MSG_ID_AVAILABLE_MODES: MAVLink_available_modes_message,
    MAVLINK_MSG_ID_CURRENT_MODE: MAVLink_current_mode_message,
    MAVLINK_MSG_ID_AVAILABLE_MODES_MONITOR: MAVLink_available_modes_monitor_message,
}
