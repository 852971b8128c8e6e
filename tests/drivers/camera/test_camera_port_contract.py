"""What every camera does, simulated or real: one suite over all twins."""

import http.server
import itertools
import queue
import threading
import time

import cv2
import numpy as np
import pytest

from firmware_sim.world.publisher import Publisher
from firmware_sim.world.truth import Picture
from robotctl.drivers.camera.simulated_camera import SimulatedCamera
from robotctl.drivers.camera.video_capture import open_camera
from robotctl.errors import LinkError
from robotctl.runtime.clock import RealClock, VirtualClock

SIZE = (64, 48)
RATE_HZ = 10.0
PERIOD_NS = 100_000_000
DEADLINE_S = 10.0


def picture(value):
    """Return a picture whose blue is `value`, with a darker lower half: order shows, and rows."""
    image = np.full((SIZE[1], SIZE[0], 3), (value, 90, 30), dtype=np.uint8)
    image[SIZE[1] // 2 :] //= 2
    return image


class Simulated:
    """firmware_sim's end of the stream."""

    def __init__(self, folder):
        address = f"ipc://{folder}/camera/pictures"
        # With room for all: what is shown within a millisecond must not be dropped here already.
        self.publisher = Publisher(address, len(VALUES) + 1)
        self.camera = SimulatedCamera(address)
        self.sequence = 0

    def show(self, value):
        data = picture(value).tobytes()
        stamp_ns = time.monotonic_ns()
        self.publisher.publish(Picture(stamp_ns, self.sequence, *SIZE, "bgr8", data))
        self.sequence += 1

    def wait_for_listener(self):
        """Publish nonsense, slowly, until the camera hears it."""
        deadline = time.monotonic() + DEADLINE_S
        while self.camera.rejected == 0:
            assert time.monotonic() < deadline, "the camera does not hear its publisher"
            self.publisher.publish(Picture(0, 0, *SIZE, "none", b""))
            time.sleep(0.02)
            self.camera.read()
        self.camera.rejected = 0

    def close(self):
        self.camera.close()
        self.publisher.close()


class Images:
    """A sequence of images, or a video, whose pictures come as time passes."""

    def __init__(self, folder, *, video):
        self.values = iter(VALUES)
        self.clock = VirtualClock(5_000_000_000)
        if video:
            source = folder / "video.avi"
            writer = cv2.VideoWriter(str(source), cv2.VideoWriter.fourcc(*"MJPG"), RATE_HZ, SIZE)
            for value in VALUES:
                writer.write(picture(value))
            writer.release()
        else:
            source = folder / "image%02d.png"
            for i, value in enumerate(VALUES):
                cv2.imwrite(str(folder / f"image{i:02d}.png"), picture(value))
        self.camera = open_camera(str(source), SIZE, RATE_HZ, self.clock)
        self.begun = False

    def show(self, value):
        assert value == next(self.values)
        if self.begun:
            self.clock.sleep_until(self.clock.now_ns() + PERIOD_NS)
        self.begun = True

    def close(self):
        self.camera.close()


class Stream:
    """A web camera: motion JPEG over HTTP."""

    def __init__(self, _folder):
        self.pictures = pictures = queue.Queue()

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=next")
                self.end_headers()
                while (image := pictures.get()) is not None:
                    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 98])[1].tobytes()
                    head = f"--next\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n"
                    self.wfile.write(head.encode() + b"\r\n" + data + b"\r\n")

            def log_message(self, *_arguments):
                pass

        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.thread = threading.Thread(target=self.server.serve_forever)
        self.thread.start()
        for _ in range(3):
            self.pictures.put(picture(0))
        port = self.server.server_address[1]
        self.camera = open_camera(f"http://127.0.0.1:{port}/camera", SIZE, RATE_HZ, RealClock())

    def show(self, value):
        # A picture is known to be whole when the next one begins.
        self.pictures.put(picture(value))
        self.pictures.put(picture(value))

    def close(self):
        self.pictures.put(None)
        self.camera.close()
        self.server.shutdown()
        self.server.server_close()
        self.thread.join()


VALUES = (40, 80, 120, 160, 200)
NEVER = -1
TWINS = {
    "simulated": Simulated,
    "images": lambda folder: Images(folder, video=False),
    "video": lambda folder: Images(folder, video=True),
    "stream": Stream,
}


@pytest.fixture(params=TWINS)
def twin(request, tmp_path):
    made = TWINS[request.param](tmp_path)
    yield made
    made.close()


def frames_until(twin, value):
    """Read until a picture of this value is there; return all that came."""
    frames = []
    deadline = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline:
        frame = twin.camera.read()
        if frame is not None:
            frames.append(frame)
            if shown(frame) == value:
                return frames
        time.sleep(0.002)
    raise AssertionError(f"no picture of {value}; there came {[shown(frame) for frame in frames]}")


def begin(twin):
    """Show the first value; return what came."""
    if isinstance(twin, Simulated):
        twin.wait_for_listener()
    twin.show(VALUES[0])
    return frames_until(twin, VALUES[0])


def shown(frame):
    """Value of `VALUES` that the picture is nearest to."""
    return min((0, *VALUES), key=lambda value: abs(value - float(frame.image[4, 4, 0])))


def test_a_picture_arrives_as_it_was_shown(twin):
    frame = begin(twin)[-1]
    assert frame.image.shape == (SIZE[1], SIZE[0], 3)
    assert frame.image.dtype == np.uint8
    assert np.abs(frame.image.astype(int) - picture(VALUES[0])).max() <= 8
    assert not frame.image.flags.writeable


def test_pictures_come_in_order_each_once_and_then_there_is_none(twin):
    frames = begin(twin)
    for value in VALUES[1:]:
        twin.show(value)
        frames += frames_until(twin, value)
    stamps = [frame.stamp_ns for frame in frames]
    numbers = [frame.sequence for frame in frames]
    assert all(a <= b for a, b in itertools.pairwise(stamps))
    assert all(a < b for a, b in itertools.pairwise(numbers))
    values = [shown(frame) for frame in frames if shown(frame) > 0]
    assert values == sorted(values)
    assert set(values) == set(VALUES)
    if not isinstance(twin, Stream):  # shows each picture twice
        assert twin.camera.read() is None


def test_who_reads_late_gets_the_newest_and_sees_the_gap(tmp_path):
    images = Images(tmp_path, video=False)
    for value in VALUES[:4]:
        images.show(value)
    frame = images.camera.read()
    assert (shown(frame), frame.sequence) == (VALUES[3], 3)
    assert frame.stamp_ns == images.clock.now_ns()
    assert images.camera.read() is None
    images.close()


@pytest.mark.parametrize("video", [False, True])
def test_who_reads_after_the_end_gets_the_last_picture_and_then_none(tmp_path, video):
    images = Images(tmp_path, video=video)
    images.clock.sleep_until(images.clock.now_ns() + 3 * len(VALUES) * PERIOD_NS)
    frame = images.camera.read()
    assert (shown(frame), frame.sequence) == (VALUES[-1], len(VALUES) - 1)
    assert frame.stamp_ns == 5_000_000_000 + (len(VALUES) - 1) * PERIOD_NS
    assert images.camera.read() is None
    images.close()


def test_a_stream_that_ends_is_an_error_that_says_so(tmp_path):
    stream = Stream(tmp_path)
    stream.show(VALUES[0])
    stream.pictures.put(None)
    with pytest.raises(LinkError, match="gives no more pictures"):
        frames_until(stream, NEVER)
    stream.close()


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("none.avi", "no such file; allowed are the number or path of a device, a URL"),
        ("77", "/dev/video77: cannot be opened: check that it is plugged in"),
        ("/dev/null", "/dev/null: cannot be opened: check that it is plugged in"),
        ("http://127.0.0.1:9/nobody", "cannot be opened as a video or stream"),
        ("none%02d.png", "cannot be opened"),
    ],
)
def test_what_cannot_be_opened_is_told_with_what_to_do(source, said, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(LinkError, match=said):
        open_camera(source, SIZE, RATE_HZ, RealClock())


def test_a_file_that_is_no_video_is_refused(tmp_path):
    path = tmp_path / "text.avi"
    path.write_text("not a video")
    with pytest.raises(LinkError, match="cannot be opened"):
        open_camera(str(path), SIZE, RATE_HZ, RealClock())


def test_pictures_of_another_size_than_calibrated_are_refused(tmp_path):
    Images(tmp_path, video=False).close()
    with pytest.raises(LinkError, match=r"gives 64 x 48 px, camera.intrinsics has 640 x 480"):
        open_camera(str(tmp_path / "image%02d.png"), (640, 480), RATE_HZ, RealClock())


def test_what_is_no_picture_is_dropped_and_counted(tmp_path):
    twin = Simulated(tmp_path)
    begin(twin)
    good = picture(VALUES[1]).tobytes()
    wrong = (
        Picture(1, 1, *SIZE, "mono8", good),
        Picture(1, 1, *SIZE, "bgr8", good[:-1]),
        Picture(1, 1, -SIZE[0], -SIZE[1], "bgr8", good),
    )
    deadline = time.monotonic() + DEADLINE_S
    for count, bad in enumerate(wrong, start=1):
        twin.publisher.publish(bad)
        while twin.camera.rejected < count and time.monotonic() < deadline:
            assert twin.camera.read() is None
            time.sleep(0.001)
    assert twin.camera.rejected == len(wrong)
    twin.close()


def test_an_address_that_is_none_is_refused():
    with pytest.raises(LinkError, match="allowed is the ipc:///PATH"):
        SimulatedCamera("nowhere")


class Device:
    """What OpenCV's V4L2 gives: pictures when it is asked, stamped by the kernel's clock."""

    def __init__(self, size, clock, told_ms):
        self.size, self.clock, self.told_ms = size, clock, told_ms
        self.set_to, self.released = {}, threading.Event()
        self.wanted = queue.Queue()

    def isOpened(self):
        return True

    def set(self, key, value):
        self.set_to[key] = value

    def get(self, key):
        return {
            cv2.CAP_PROP_FRAME_WIDTH: self.size[0],
            cv2.CAP_PROP_FRAME_HEIGHT: self.size[1],
            cv2.CAP_PROP_POS_MSEC: self.told_ms,
        }[key]

    def grab(self):
        self.image = self.wanted.get()
        return self.image is not None

    def retrieve(self):
        if isinstance(self.image, Exception):
            raise self.image
        return True, self.image

    def release(self):
        self.released.set()


@pytest.mark.parametrize(("told_ms", "stamp_ns"), [(980.0, 980_000_000), (0.0, 1_500_000_000)])
def test_a_device_is_asked_for_its_size_and_its_own_stamp_is_taken(monkeypatch, told_ms, stamp_ns):
    clock = VirtualClock(1_500_000_000)
    device = Device(SIZE, clock, told_ms)
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: device if number == 3 else None)
    camera = open_camera("3", SIZE, RATE_HZ, clock)
    assert device.set_to == {
        cv2.CAP_PROP_FRAME_WIDTH: SIZE[0],
        cv2.CAP_PROP_FRAME_HEIGHT: SIZE[1],
        cv2.CAP_PROP_FPS: RATE_HZ,
    }
    assert camera.read() is None
    device.wanted.put(picture(VALUES[0]))
    deadline = time.monotonic() + DEADLINE_S
    while (frame := camera.read()) is None:
        assert time.monotonic() < deadline, "no picture came"
        time.sleep(0.001)
    assert frame.stamp_ns == stamp_ns
    device.wanted.put(None)
    camera.close()
    assert device.released.is_set()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (cv2.error("decoder: corrupt"), r"camera 3: gives no more pictures \(decoder: corrupt\)"),
        (np.zeros((48, 64), dtype=np.uint8), r"gives no more pictures \(image must be"),
        (None, "gives no more pictures; check"),
    ],
)
def test_a_device_that_fails_is_told_and_let_go(monkeypatch, given, said):
    device = Device(SIZE, VirtualClock(), 0.0)
    monkeypatch.setattr(cv2, "VideoCapture", lambda _number: device)
    camera = open_camera("3", SIZE, RATE_HZ, VirtualClock())
    device.wanted.put(given)
    assert device.released.wait(DEADLINE_S)
    with pytest.raises(LinkError, match=said):
        camera.read()
    camera.close()
