"""The web page's server: what a browser sees of the robot, and may ask of it.

Public names:

- `config.WebConfig`: its section of a robot's file
- `server.PageServer`, `server.RobotSide`, `listening.PageHost`, `listening.listen`: the server
- `desk.Desk`, `driving.Driving`, `stops.Stops`: what clients ask for, and who of them drives
- `access.Access`, `access.Role`, `secret_files.tokens_of`, `links.read_links`: who may do what
- `outbox.Outbox`, `wire.Hello`, `published.read`: what a client is sent
"""
