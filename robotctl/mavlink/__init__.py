"""The MAVLink vehicle: services between the robot and its ground stations.

Public names:

- `telemetry.Telemetry`, `config.MavlinkConfig`, `context.TelemetryRobot`: the vehicle on some links
- `services.registry.SERVICES`, `service.Microservice`, `catalogue.Stream`, `command.Command`: its
  microservices, and what one is
"""
