"""What connects a simulated run with its processes: sockets, a clock file, and their folder."""

from __future__ import annotations

import os
import shutil
from typing import TypeAlias

import zmq

from robotctl.app.scoring.score import Truth
from robotctl.messages.control import ControlState, NavigationState, Notice
from robotctl.messages.estimation import (
    CameraView,
    LiveMap,
    LocalisationState,
    ParticleCloud,
    PlanView,
)
from robotctl.runtime.ipc.run_folder import hold_folder, remove_dead_runs, simulated_instance
from robotctl.runtime.ipc.topics import (
    Endpoints,
    RequestSender,
    Subscriber,
    endpoint_directory,
    ring_path,
)

Heard: TypeAlias = (
    ControlState
    | NavigationState
    | LocalisationState
    | ParticleCloud
    | PlanView
    | LiveMap
    | CameraView
    | Notice
)


class RunLinks:
    """The links of one run.

    Attributes
    ----------
    instance
        Name of the run among those of this computer.
    states, truths
        Published messages.
    to_control, to_navigation
        Senders of requests.
    """

    def __init__(self) -> None:
        remove_dead_runs()
        self.instance = simulated_instance()
        self._held = hold_folder(self.instance)
        self.folder = endpoint_directory(self.instance)
        self.clock_file = ring_path(self.instance).with_suffix(".clock")
        self.endpoints = Endpoints(self.folder)
        self._context = zmq.Context()
        self.states = Subscriber[Heard](self._context, self.endpoints.published, Heard)
        self.truths = Subscriber[Truth](self._context, (self.endpoints.truth,), Truth)
        self.to_control = RequestSender(self._context, self.endpoints.control_requests)
        self.to_navigation = RequestSender(self._context, self.endpoints.navigation_requests)

    def close(self) -> None:
        """Close the sockets and remove the folder."""
        self._context.destroy(linger=0)
        shutil.rmtree(self.folder, ignore_errors=True)
        self.clock_file.unlink(missing_ok=True)
        os.close(self._held)
