"""Messages between processes, over real sockets."""

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from robotctl.errors import LinkError
from robotctl.messages.control import (
    Arm,
    ControlRequest,
    EmergencyStop,
    EmergencyStopSource,
    NavigationRequest,
    Notice,
    SetMode,
    VelocityCommand,
)
from robotctl.runtime.ipc.topics import (
    Endpoints,
    Publisher,
    RequestReceiver,
    RequestSender,
    Subscriber,
    endpoint_directory,
    endpoint_path,
)


class Closing(zmq.Context):
    """A context whose sockets live as long as it does, so that none is left to the collector."""

    kept: list[zmq.Socket]

    def socket(self, *args, **kwargs):
        self.kept.append(super().socket(*args, **kwargs))
        return self.kept[-1]


@pytest.fixture
def context() -> Iterator[zmq.Context]:
    context = Closing()
    context.kept = []
    yield context
    context.destroy(linger=0)


@pytest.fixture
def endpoints(tmp_path: Path) -> Endpoints:
    return Endpoints(tmp_path)


def until(condition: Callable[[], object], seconds: float = 5.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.002)


def test_requests_arrive_in_order_and_as_they_were(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    receiver = RequestReceiver[ControlRequest](context, endpoints.control_requests, ControlRequest)
    sender = RequestSender(context, endpoints.control_requests)
    sent = [
        Arm(stamp_ns=1, request_id=7, arm=True),
        VelocityCommand(2, 3, 0.25, -0.5),
        EmergencyStop(4, EmergencyStopSource.GROUND_STATION),
    ]
    until(lambda: sender.send(sent[0]))
    assert all(sender.send(message) for message in sent[1:])
    got: list[ControlRequest] = []
    until(lambda: got.extend(receiver.receive()) or len(got) == 3)
    assert got == sent


def test_no_request_stays_behind_however_reading_and_writing_interleave(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    receiver = RequestReceiver[ControlRequest](context, endpoints.control_requests, ControlRequest)
    senders = [RequestSender(context, endpoints.control_requests) for _ in range(2)]
    for sender in senders:
        until(lambda sender=sender: sender.send(Arm(0, 0, arm=True)))
    got: list[ControlRequest] = []
    sent = len(senders)

    def all_are_there() -> bool:
        got.extend(receiver.receive())
        return len(got) == sent

    until(all_are_there)
    for burst in range(2000):
        for number in range(burst % 4):
            sent += senders[number % 2].send(Arm(sent, burst, arm=True))
        got += receiver.receive()
        if burst % 100 == 0:
            until(all_are_there)
    until(all_are_there)
    assert sent > 1000  # a sender whose queue is full refuses


def test_a_request_to_a_process_that_is_not_there_is_dropped_not_kept(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    sender = RequestSender(context, endpoints.control_requests)
    assert not sender.send(Arm(stamp_ns=1, request_id=1, arm=True))
    receiver = RequestReceiver[ControlRequest](context, endpoints.control_requests, ControlRequest)
    second = Arm(stamp_ns=2, request_id=2, arm=True)
    until(lambda: sender.send(second))
    got: list[ControlRequest] = []
    until(lambda: got.extend(receiver.receive()) or got)
    assert got == [second]


def test_a_message_of_another_kind_is_dropped_and_counted(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    receiver = RequestReceiver[ControlRequest](context, endpoints.control_requests, ControlRequest)
    sender = RequestSender(context, endpoints.control_requests)
    until(lambda: sender.send(SetMode(1, 4)))
    until(lambda: receiver.receive() == [] and receiver.rejected == 1)
    navigation = RequestReceiver[NavigationRequest](
        context, endpoints.navigation_requests, NavigationRequest
    )
    assert navigation.receive() == []


def test_a_listener_hears_a_publisher_that_starts_later_and_again(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    listener = Subscriber[Notice](context, (endpoints.control_state,), Notice)
    for text in ("first life", "second life"):
        publisher = Publisher(context, endpoints.control_state)
        got: list[Notice] = []

        def heard(
            publisher: Publisher = publisher, got: list[Notice] = got, text: str = text
        ) -> bool:
            publisher.send(Notice(0, 6, text))
            got.extend(listener.receive())
            return any(notice.text == text for notice in got)

        until(heard)
        assert got[-1].text == text
        publisher.close()


def test_who_listens_from_the_start_and_who_listens_late_are_greeted_once_each(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    def listen() -> Subscriber[Notice]:
        return Subscriber[Notice](context, (endpoints.control_state,), Notice)

    def heard(listener: Subscriber[Notice]) -> list[str]:
        texts: list[str] = []

        def enough() -> bool:
            publisher.send(Notice(0, 6, "news"))
            texts.extend(notice.text for notice in listener.receive())
            return texts.count("news") > 3

        until(enough)
        return [text for text in texts if text != "news"]

    early = listen()
    publisher = Publisher(context, endpoints.control_state)
    publisher.greet(Notice(1, 4, "the start"))
    assert heard(early) == ["the start"]
    late = listen()
    assert heard(late) == ["the start"]
    publisher.greet(Notice(2, 4, "what came later"))
    latest = listen()
    assert heard(latest) == ["what came later"]
    assert heard(early) == heard(late) == heard(latest) == []


def test_a_publisher_that_says_nothing_greets_when_it_attends(
    context: zmq.Context, endpoints: Endpoints
) -> None:
    publisher = Publisher(context, endpoints.recorder_notices)
    publisher.greet(Notice(1, 4, "the start"))
    listener = Subscriber[Notice](context, (endpoints.recorder_notices,), Notice)
    got: list[Notice] = []

    def attended() -> bool:
        publisher.attend()
        got.extend(listener.receive())
        return bool(got)

    until(attended)
    assert got == [Notice(1, 4, "the start")]


def test_a_folder_too_deep_for_sockets_is_refused_with_what_to_set(
    context: zmq.Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as short:
        fits = Path(short, "x" * (107 - len(f"{short}//robotctl/robot/navigation.requests")))
        fits.mkdir(mode=0o700)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(fits))
        address = Endpoints(endpoint_directory("robot")).navigation_requests
        assert len(address) == len("ipc://") + 107
        RequestReceiver[NavigationRequest](context, address, NavigationRequest)
        with pytest.raises(LinkError, match=r"1 bytes too long .* XDG_RUNTIME_DIR"):
            endpoint_directory("robot1")


def test_a_directory_open_to_others_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    directory = endpoint_directory("robot")
    assert directory.stat().st_mode & 0o777 == 0o700
    directory.chmod(0o755)
    with pytest.raises(LinkError, match="closed to others"):
        endpoint_directory("robot")


@pytest.mark.parametrize("name", ["", ".", "..", "../robot", "/tmp/robot", "robot/.."])
def test_a_name_that_leads_elsewhere_is_refused_and_nothing_is_made(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(LinkError, match="the name of a robot must not"):
        endpoint_directory(name)
    assert not any(tmp_path.iterdir())


def test_a_path_is_that_of_the_directory_and_asking_for_it_makes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    path = endpoint_path("robot")
    assert not any(tmp_path.iterdir())
    assert endpoint_directory("robot") == path


def test_binding_an_address_twice_names_it(context: zmq.Context, tmp_path: Path) -> None:
    with pytest.raises(LinkError, match="nowhere"):
        Publisher(context, f"ipc://{tmp_path}/nowhere/socket")
