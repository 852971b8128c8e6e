"""The robot computer: installation, service files and the doctor.

Public names:

- `doctor.examine`, `service_files.service_files`: findings of the doctor; files of a service
"""
