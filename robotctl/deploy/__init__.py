"""The robot computer: installation, service files and the doctor."""
