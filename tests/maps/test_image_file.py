"""Images against netpbm's definition of PGM and PPM, read word by word, and against OpenCV."""

from __future__ import annotations

import re
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from robotctl.errors import ConfigError
from robotctl.maps.image_file import orientation, read_image
from robotctl.maps.map_file import load_map
from robotctl.workbench.camera.pictures import read_picture

GAPS = (b" ", b"\n", b"\t", b"\r\n", b" # a comment\n", b"\n#\n# another: 7 8\n")


def shades_by_the_book(values, maxval, samples):
    """Return what netpbm says that samples mean, each scaled to the whole 255 or 65535."""
    white = 255 if maxval < 256 or samples == 3 else 65535
    return [min(round(value / maxval * white), white) / white for value in values]


@st.composite
def pnm(draw):
    """Draw magic, width, height, maxval, samples, and gaps between the words of the header."""
    magic = draw(st.sampled_from([b"P2", b"P3", b"P5", b"P6"]))
    width, height = draw(st.integers(1, 6)), draw(st.integers(1, 5))
    maxval = draw(st.one_of(st.integers(1, 65535), st.sampled_from([1, 100, 254, 255, 256, 65535])))
    samples = 3 if magic in {b"P3", b"P6"} else 1
    count = width * height * samples
    values = draw(st.lists(st.integers(0, maxval), min_size=count, max_size=count))
    gaps = [draw(st.sampled_from(GAPS)) for _ in range(3)]
    return magic, width, height, maxval, samples, values, gaps, draw(st.booleans())


def written(magic, width, height, maxval, values, gaps, has_last_newline):
    words = [magic, *(str(number).encode() for number in (width, height, maxval))]
    header = b"".join(word + gap for word, gap in zip(words, [*gaps, b"\n"], strict=True))
    if magic in {b"P5", b"P6"}:
        return header + np.array(values, ">u2" if maxval > 255 else "u1").tobytes()
    plain = b" ".join(str(value).encode() for value in values)
    return header + plain + (b"\n" if has_last_newline else b"")


@given(pnm())
def test_pgm_and_ppm_of_any_greatest_value_are_scaled_to_white(tmp_path_factory, drawn):
    magic, width, height, maxval, samples, values, gaps, has_last_newline = drawn
    file = tmp_path_factory.mktemp("pnm") / "room.pnm"
    file.write_bytes(written(magic, width, height, maxval, values, gaps, has_last_newline))
    pixels = read_image(file)
    assert pixels.shape == ((height, width) if samples == 1 else (height, width, 3))
    expected = shades_by_the_book(values, maxval, samples)
    np.testing.assert_allclose(pixels.ravel() / np.iinfo(pixels.dtype).max, expected, atol=1e-9)


def in_a_map(folder, data, name="room.pgm", **keys):
    (folder / name).write_bytes(data)
    values = {"image": name, "resolution": 0.05, "origin": [0, 0, 0], **keys}
    path = folder / "room.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in values.items()))
    return path


@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [0, 1])
@pytest.mark.parametrize("maxval", [1, 7, 100, 254])
def test_a_map_of_another_greatest_value_is_that_of_the_same_picture_scaled_to_255(
    tmp_path, mode, negate, maxval
):
    values = np.arange(maxval + 1)
    rows = np.stack([values, values[::-1]])
    scaled = np.array([[round(255 * int(value) / maxval) for value in row] for row in rows])
    header = f"P5 {maxval + 1} 2 "
    keys = {"mode": mode, "negate": negate}
    found = load_map(
        in_a_map(tmp_path, f"{header}{maxval}\n".encode() + bytes(rows.ravel().tolist()), **keys)
    )
    wanted = load_map(
        in_a_map(tmp_path, f"{header}255\n".encode() + bytes(scaled.ravel().tolist()), **keys)
    )
    np.testing.assert_array_equal(found.cells, wanted.cells)


def test_a_picture_of_any_kind_means_what_is_seen_of_it(tmp_path):
    grey = np.array([[0, 254], [205, 254]], np.uint8)
    expected = [[-1, 0], [100, 0]]
    colour = np.repeat(grey[:, :, None], 3, axis=2)
    opaque = np.dstack([colour, np.full((2, 2), 255, np.uint8)])
    deep = grey.astype(np.uint16) * 257
    for name, pixels in {
        "grey.png": grey,
        "grey.bmp": grey,
        "grey.tif": grey,
        "deep.png": deep,
        "deep.tif": deep,
        "deep.pgm": deep,
        "colour.png": colour,
        "colour.ppm": colour,
        "deep_colour.png": colour.astype(np.uint16) * 257,
        "colour.webp": colour,
    }.items():
        assert cv2.imwrite(str(tmp_path / name), pixels, [cv2.IMWRITE_WEBP_QUALITY, 101])
        path = in_a_map(tmp_path, (tmp_path / name).read_bytes(), name, free_thresh=0.19)
        assert load_map(path).cells.tolist() == expected, name
    # With alpha, opaque as it is, the average is lighter: as the map server has it.
    assert cv2.imwrite(str(tmp_path / "alpha.png"), opaque)
    path = in_a_map(tmp_path, (tmp_path / "alpha.png").read_bytes(), "alpha.png", mode="scale",
                    free_thresh=0.19, occupied_thresh=0.65)  # fmt: skip
    assert load_map(path).cells.tolist() == [[1, 0], [100, 0]]


P5 = b"P5\n4 3\n255\n" + bytes(12)
PNG = cv2.imencode(".png", np.random.default_rng(0).integers(0, 255, (40, 60), np.uint8))[1]


@pytest.mark.parametrize(
    "data",
    [
        P5[:-1],
        P5[:12],
        b"P6 2 2 255\n" + bytes(11),
        b"P5 2 2 1000\n" + bytes(7),
        b"P5 2 2 100\n" + bytes(3),
        b"P2\n4 3\n255\n0 254 205 254",
        b"P2\n4 3\n100\n0 25 20 54",
        b"P2\n4 3\n",
        b"P5\n4",
        b"P4 64 3\n" + bytes(23),
        PNG.tobytes()[: len(PNG) // 2],
    ],
)
def test_a_file_that_ends_too_soon_is_cut_short_and_nothing_else_is_printed(tmp_path, capfd, data):
    with pytest.raises(ConfigError, match=r"room\.pgm: cut short within its"):
        load_map(in_a_map(tmp_path, data))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "no image that can be read"),
        (b"P5\n0 3\n255\n", "no image that can be read"),
        (b"P5\n2 1\n0\n..", "damaged: maxval must be greater than 0"),
        (b"P5\n2 1\n70000\n....", "damaged: maxval must be greater than 0 and less than 65536"),
        (b"P2\n2 1\n255\n0 white", "damaged: invalid literal"),
        (b"P2\n2 1\n100\n0 101", "damaged: .*101"),
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n", "no image that can be read"),
        (PNG.tobytes()[:60] + b"x" + PNG.tobytes()[61:], "damaged: "),
        (b"P5\n40000 40000\n255\n", "too large: "),
    ],
)
def test_what_is_no_sound_image_is_said(tmp_path, capfd, data, message):
    with pytest.raises(ConfigError, match=re.escape("room.pgm: ") + message):
        load_map(in_a_map(tmp_path, data))
    assert capfd.readouterr() == ("", "")


def with_orientation(data, tag, order="<"):
    """Return a JPEG whose EXIF block (application segment 1) has a tag of orientation, as bytes."""
    mark = b"II" if order == "<" else b"MM"
    tiff = mark + struct.pack(order + "HIHHHIHHI", 42, 8, 1, 0x0112, 3, 1, tag, 0, 0)
    segment = b"Exif\0\0" + tiff
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + data[2:]


def scene():
    """Draw a picture, blue, green and red, in which no turn or mirror looks like another."""
    picture = np.full((48, 64, 3), 200, np.uint8)
    picture[4:12, 4:40] = (20, 90, 160)
    picture[12:40, 4:10] = (150, 40, 60)
    return picture


@pytest.mark.parametrize("tag", range(1, 9))
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_picture_is_read_as_the_sensor_has_it_whatever_its_orientation(tmp_path, tag, order):
    data = cv2.imencode(".jpg", scene())[1].tobytes()
    (tmp_path / "plain.jpg").write_bytes(data)
    (tmp_path / "tagged.jpg").write_bytes(with_orientation(data, tag, order))
    assert orientation(tmp_path / "plain.jpg") == 1
    assert orientation(tmp_path / "tagged.jpg") == tag
    found = read_picture(tmp_path / "tagged.jpg")
    np.testing.assert_array_equal(found, read_picture(tmp_path / "plain.jpg"))
    # OpenCV, told to follow the tag, turns it: so the tag is one.
    turned = cv2.imread(str(tmp_path / "tagged.jpg"))
    assert (turned.shape == found.shape and np.array_equal(turned, found)) == (tag == 1)


@pytest.mark.parametrize("tag", range(1, 9))
@pytest.mark.parametrize("suffix", ["png", "webp", "tiff"])
def test_so_is_one_of_another_format(tmp_path, tag, suffix):
    file = tmp_path / f"tagged.{suffix}"
    tags = Image.Exif()
    tags[0x0112] = tag
    Image.fromarray(scene()[..., ::-1]).save(file, exif=tags, lossless=True)
    np.testing.assert_array_equal(read_picture(file), scene())
    assert orientation(file) == tag


def picture_files(folder):
    """Write a picture in all kinds of files; return their paths."""
    picture, grey = Image.fromarray(scene()[..., ::-1]), Image.fromarray(scene()[..., 0])
    mask = Image.fromarray(np.tile(np.arange(64, dtype=np.uint8) * 4, (48, 1)))
    kinds = {
        "colour.jpg": (picture, {}),
        "progressive.jpg": (picture, {"progressive": True}),
        "grey.jpg": (grey, {}),
        "palette.png": (picture.quantize(16), {}),
        "bits.png": (grey.point(lambda value: 255 * (value > 100), "1"), {}),
        "alpha.png": (Image.merge("RGBA", (*picture.split(), mask)), {}),
        "grey_alpha.png": (Image.merge("LA", (grey, mask)), {}),
        "colour.bmp": (picture, {}),
        "colour.webp": (picture, {"lossless": True}),
        "colour.tif": (picture, {"compression": "tiff_lzw"}),
        "colour.gif": (picture, {}),
    }
    for name, (image, options) in kinds.items():
        image.save(folder / name, **options)
    deep = scene().astype(np.uint16) * 257
    for name, pixels in {
        "deep.png": deep[..., 0],
        "deep_colour.png": deep,
        "deep.tif": deep,
    }.items():
        assert cv2.imwrite(str(folder / name), pixels)
        kinds[name] = None
    return [folder / name for name in kinds]


def test_each_kind_of_picture_has_the_pixels_that_opencv_finds(tmp_path):
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    for file in picture_files(tmp_path):
        found = read_picture(file)
        assert (found.dtype, found.flags.c_contiguous) == (np.uint8, True), file.name
        np.testing.assert_array_equal(found, cv2.imread(str(file), flags), file.name)


def test_the_ink_of_a_printer_becomes_light(tmp_path):
    Image.fromarray(scene()[..., ::-1]).convert("CMYK").save(tmp_path / "ink.jpg", quality=98)
    apart = np.abs(read_picture(tmp_path / "ink.jpg").astype(int) - scene())
    assert np.median(apart) <= 2


def test_a_picture_cut_anywhere_is_said_to_be_or_has_all_of_its_pixels(tmp_path, capfd):
    rng = np.random.default_rng(3)
    for whole in picture_files(tmp_path):
        data = whole.read_bytes()
        lengths = rng.integers(0, len(data), 25).tolist()
        for length in {0, 1, 8, len(data) // 2, len(data) - 1, *lengths}:
            cut = tmp_path / f"cut{whole.suffix}"
            cut.write_bytes(data[:length])
            try:
                np.testing.assert_array_equal(read_picture(cut), read_picture(whole))
                assert length > len(data) - 25  # what is behind the pixels
            except ConfigError as error:
                assert re.search(r"cut\.\w+: (cut short|damaged|no image)", str(error))  # noqa: PT017
        # libtiff has its own words for a directory that is cut.
        assert capfd.readouterr() == ("", "") or whole.suffix == ".tif"
