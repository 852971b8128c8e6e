"""What people are told of the camera: each change, but not each picture's verdict."""

from robotctl.app.processes.camera import CameraNotices

SECOND_NS = 1_000_000_000
DARK = "the picture is too dark"


def told(troubles: list[str], rate_hz: int = 20) -> list[tuple[float, int, str]]:
    """When [s], with which severity, and what is said of so many pictures."""
    news = CameraNotices()
    period_ns = SECOND_NS // rate_hz
    steps = [news.step(each, number * period_ns) for number, each in enumerate(troubles)]
    return [(each.stamp_ns / SECOND_NS, each.severity, each.text) for each in steps if each]


def test_what_holds_at_the_start_and_each_change_is_said_once() -> None:
    assert told([""] * 200 + [DARK] * 200 + [""] * 200) == [
        (0.0, 6, "the camera sees the floor"),
        (10.0, 4, f"the camera cannot judge the floor: {DARK}"),
        (20.0, 6, "the camera sees the floor"),
    ]


def test_a_camera_that_cannot_make_up_its_mind_is_heard_every_five_seconds_at_most() -> None:
    said = told([DARK, "", ""] * 100)
    assert [time_s for time_s, _, _ in said] == [0.0, 5.0, 10.05]
    assert len({text for _, _, text in said}) == 2


def test_the_last_word_is_what_lasts() -> None:
    said = told([""] * 20 + [DARK] * 10 + [""] * 10 + [DARK] * 200)
    assert said[-1] == (5.0, 4, f"the camera cannot judge the floor: {DARK}")
    assert len(said) == 2
