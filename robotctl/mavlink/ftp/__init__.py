"""MAVLink FTP: files over MAVLink. https://mavlink.io/en/services/ftp.html."""
