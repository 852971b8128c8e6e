"""Folders of images with times: by name, by the lists of known data sets, and what is refused."""

import pytest

from robotctl.logs.formats.image_folder import TimedImage, image_name, images_in, timed_images
from robotctl.logs.formats.log_text import LogFormatError


def make(folder, *names):
    folder.mkdir(parents=True, exist_ok=True)
    for name in names:
        (folder / name).touch()
    return folder


def times_and_names(folder):
    return [(each.stamp_ns, each.path.name) for each in timed_images(folder)]


@pytest.mark.parametrize(
    ("name", "stamp_ns"),
    [
        ("1305031102.175304", 1_305_031_102_175_304_000),
        ("1248446182.116000001", 1_248_446_182_116_000_001),
        ("0.5", 500_000_000),
        ("1403636579763555584", 1_403_636_579_763_555_584),
        ("0000000012345678901", 12_345_678_901),
        ("1403636579763555", 1_403_636_579_763_555_000),
        ("1403636579763", 1_403_636_579_763_000_000),
    ],
)
def test_a_name_is_a_time_in_seconds_or_by_its_digits(tmp_path, name, stamp_ns):
    file = make(tmp_path / "a", f"{name}.png") / f"{name}.png"
    assert timed_images(tmp_path / "a") == [TimedImage(stamp_ns, file)]


def test_images_come_in_the_order_of_time(tmp_path):
    folder = make(tmp_path / "a", "10.25.JPG", "9.5.jpg", "100.0.png", "notes.md")
    assert [name for _, name in times_and_names(folder)] == ["9.5.jpg", "10.25.JPG", "100.0.png"]


def test_our_own_names_hold_any_time_and_sort_by_it(tmp_path):
    stamps_ns = [0, 999, 86_400_000_000_000 * 20, 1_800_000_000_123_456_789]
    folder = make(tmp_path / "pictures", *(f"{image_name(each)}.jpg" for each in stamps_ns))
    assert [each.stamp_ns for each in timed_images(folder)] == stamps_ns
    assert sorted(images_in(folder)) == images_in(folder)


def test_the_list_of_tum_beside_the_folder_or_given_itself(tmp_path):
    make(tmp_path / "rgb", "a.png", "b.png", "unused.png")
    make(tmp_path / "depth", "1.5.png")
    (tmp_path / "rgb.txt").write_text(
        "# color images\n# timestamp filename\n"
        "1305031103.25 rgb/b.png\n1305031102.175304 rgb/a.png\n"
    )
    wanted = [(1_305_031_102_175_304_000, "a.png"), (1_305_031_103_250_000_000, "b.png")]
    assert times_and_names(tmp_path / "rgb") == wanted
    assert times_and_names(tmp_path) == wanted
    assert times_and_names(tmp_path / "depth") == [(1_500_000_000, "1.5.png")]


def test_the_list_of_euroc_beside_its_data(tmp_path):
    make(tmp_path / "cam0" / "data", "1403636579763555584.png", "x.png")
    (tmp_path / "cam0" / "data.csv").write_text(
        "#timestamp [ns],filename\n"
        "1403636579763555584,1403636579763555584.png\n1403636579813555456,x.png\n"
    )
    assert times_and_names(tmp_path / "cam0" / "data") == [
        (1_403_636_579_763_555_584, "1403636579763555584.png"),
        (1_403_636_579_813_555_456, "x.png"),
    ]


def test_the_list_of_kitti_is_in_the_order_of_names(tmp_path):
    make(tmp_path / "image_0", "000002.png", "000000.png", "000001.png")
    (tmp_path / "times.txt").write_text("0.000000e+00\n1.036224e-01\n2.073390e-01\n")
    assert times_and_names(tmp_path / "image_0") == [
        (0, "000000.png"),
        (103_622_400, "000001.png"),
        (207_339_000, "000002.png"),
    ]


def test_numbers_in_names_count_by_their_value(tmp_path):
    folder = make(tmp_path / "a", "10.jpg", "2.jpg")
    (folder / "times.txt").write_text("1.5\n2.5\n")
    assert times_and_names(folder) == [(1_500_000_000, "2.jpg"), (2_500_000_000, "10.jpg")]


@pytest.mark.parametrize(
    ("names", "listed", "message"),
    [
        ([], None, r"a: no images in it, of \.png"),
        (["000001.png"], None, r"000001\.png: the name is no time; allowed are seconds .*\(a\.txt"),
        (["12345.jpg", "1.5.jpg"], None, r"12345\.jpg: the name is no time"),
        (["9999999999.5.jpg"], None, r"time 9999999999\.5 s: allowed are up to 9\.2e\+09 s"),
        (["a.png"], "1.0\n2.0\n", r"times\.txt: 2 times for 1 images"),
        (["a.png"], "# nothing\n", r"times\.txt: no times in it"),
        (["a.png"], "1.0 b.png\n", r"times\.txt:1: b\.png: no such file in "),
        (["a.png"], "1.0 a.png\n2.0\n", r"times\.txt:2: found '2\.0' alone"),
        (["a.png"], "#\nsoon a.png\n", r"times\.txt:2: found 'soon', a time is needed"),
        (["a.png"], "nan\n", r"times\.txt:1: time nan: allowed are -100000 to 9\.2e\+09 s"),
        (["a.png"], "14036365797635\n", r"times\.txt:1: time 14036365797635: allowed"),
    ],
)
def test_what_has_no_times_is_refused_with_its_place(tmp_path, names, listed, message):
    folder = make(tmp_path / "a", *names)
    if listed is not None:
        (folder / "times.txt").write_text(listed)
    with pytest.raises(LogFormatError, match=message):
        timed_images(folder)


def test_a_folder_whose_images_are_one_further_down_says_so(tmp_path):
    make(tmp_path / "empty")
    make(tmp_path / "pictures-0001", "1.5.png")
    with pytest.raises(LogFormatError, match=r"no images in it.*some in .*/pictures-0001$"):
        timed_images(tmp_path)


def test_a_file_or_nothing_is_no_folder(tmp_path):
    with pytest.raises(LogFormatError, match="a folder of images is needed, found nothing"):
        timed_images(tmp_path / "a")
    (tmp_path / "a").touch()
    with pytest.raises(LogFormatError, match="a folder of images is needed, found a file"):
        timed_images(tmp_path / "a")
