"""Readers and writers of recordings.

Public names:

- `formats.recorded_log.read_recording`, `formats.recorded_log.read_reference`,
  `formats.recorded_log.LOG_FORMATS`: any log, or its reference poses
- `formats.tum.write_tum`, `mcap.log.McapLog`: writers
"""
