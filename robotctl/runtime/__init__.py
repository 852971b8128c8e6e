"""How steps are run: clock, loop, sockets between processes, recorder, storage.

Public names:

- `clock.RealClock`, `clock.VirtualClock`, `loop.Loop`: clocks, and the loop with absolute deadlines
- `ipc.topics.Endpoints`, `ipc.topics.Subscriber`, `ipc.topics.RequestSender`: listening to a robot
  that runs, and asking it
- `flight.recorder.read_record`, `flight.ring.FlightRing`: records of the control loop
- `storage.state_file.StateFile`, `storage.log_folder.LogFolder`: files that survive a power cut
"""
