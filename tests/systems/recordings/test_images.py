"""Images of all encodings become the same colours and depths."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from crossmodal.systems.recordings.images import color_of, depth_of, is_depth, size_of
from crossmodal.systems.recordings.recording import RecordingError

RGB = np.random.default_rng(0).integers(0, 256, (6, 5, 3), dtype=np.uint8)
MM = np.array([[0, 500, 1000], [1500, 2000, 65535]], dtype=np.uint16)
ALPHA = np.full((6, 5, 1), 255, dtype=np.uint8)


def raw(array: np.ndarray, encoding: str, **fields: object) -> SimpleNamespace:
    made = {
        "height": array.shape[0],
        "width": array.shape[1],
        "encoding": encoding,
        "is_bigendian": 0,
        "step": array.strides[0],
        "data": np.frombuffer(array.tobytes(), dtype=np.uint8),
    }
    return SimpleNamespace(**(made | fields))


def packed(image: np.ndarray, ending: str, kind: str, before: bytes = b"") -> SimpleNamespace:
    data = before + cv2.imencode(ending, image)[1].tobytes()
    return SimpleNamespace(format=kind, data=np.frombuffer(data, dtype=np.uint8))


@pytest.mark.parametrize(
    "message",
    [
        raw(RGB, "rgb8"),
        raw(np.ascontiguousarray(RGB[:, :, ::-1]), "bgr8"),
        raw(np.concatenate([RGB, ALPHA], axis=2), "rgba8"),
        raw(np.concatenate([RGB[:, :, ::-1], ALPHA], axis=2), "bgra8"),
        packed(RGB[:, :, ::-1], ".png", "rgb8; png compressed bgr8"),
        packed(np.concatenate([RGB[:, :, ::-1], ALPHA], axis=2), ".png", "png"),
    ],
    ids=["rgb8", "bgr8", "rgba8", "bgra8", "png", "png with alpha"],
)
def test_colours_are_those_that_were_written(message: SimpleNamespace) -> None:
    assert_array_equal(color_of(message), RGB)
    assert size_of(message) == (5, 6)


def test_grey_has_three_equal_channels() -> None:
    grey = np.ascontiguousarray(RGB[:, :, 0])
    for message in (raw(grey, "mono8"), packed(grey, ".png", "mono8; png compressed ")):
        assert_array_equal(color_of(message), np.repeat(grey[:, :, None], 3, axis=2))


def test_a_jpeg_is_about_the_image() -> None:
    smooth = np.tile(np.linspace(0, 255, 32, dtype=np.uint8)[:, None, None], (1, 32, 3))
    smooth[:, :, 2] = 40  # Blue.
    found = color_of(packed(smooth[:, :, ::-1], ".jpg", "rgb8; jpeg compressed bgr8"))
    assert np.abs(found.astype(int) - smooth).max() < 30


def test_a_bayer_image_has_its_colour() -> None:
    mosaic = np.zeros((8, 8), dtype=np.uint8)
    mosaic[0::2, 0::2] = 200  # Red in an RGGB pattern.
    found = color_of(raw(mosaic, "bayer_rggb8"))
    assert (found[2:6, 2:6, 0] > 150).all()
    assert (found[2:6, 2:6, 2] == 0).all()


def test_padded_rows_and_a_last_one_without_padding_are_read() -> None:
    padded = np.zeros((6, 20), dtype=np.uint8)
    padded[:, :15] = RGB.reshape(6, 15)
    assert_array_equal(color_of(raw(RGB, "rgb8", step=20, data=padded.ravel())), RGB)
    assert_array_equal(color_of(raw(RGB, "rgb8", step=20, data=padded.ravel()[:-5])), RGB)


METRES = MM / np.float32(1000.0)


@pytest.mark.parametrize(
    "message",
    [
        raw(MM, "16UC1"),
        raw(MM.astype(">u2"), "16UC1", is_bigendian=1),
        raw(MM, "mono16"),
        raw(METRES.astype(np.float32), "32FC1"),
        raw(METRES.astype(">f4"), "32FC1", is_bigendian=1),
        packed(MM, ".png", "16UC1; compressedDepth png", bytes(12)),
        packed(MM, ".png", "16UC1; png compressed "),
    ],
    ids=["mm", "big endian", "mono16", "m", "m, big endian", "compressedDepth", "png"],
)
def test_depths_are_in_metres(message: SimpleNamespace) -> None:
    assert_allclose(depth_of(message), METRES, rtol=1e-6)
    assert depth_of(message).dtype == np.float32
    assert size_of(message) == (3, 2)


def test_compressed_depth_of_32_bit_is_inverted_and_zero_where_nothing_was_measured() -> None:
    a, b = 10000.0, 50.0
    depth = np.array([[0.5, 1.0], [2.0, 4.0]])
    k = np.round(a / depth + b).astype(np.uint16)
    k[1, 1] = 0
    before = np.int32(0).tobytes() + np.array([a, b], dtype="<f4").tobytes()
    found = depth_of(packed(k, ".png", "32FC1; compressedDepth png", before))
    assert_allclose(found, [[0.5, 1.0], [2.0, 0.0]], rtol=1e-3)


def test_what_is_not_measured_is_zero_and_beyond_range_stays_infinite() -> None:
    data = np.array([[np.nan, np.inf, 0.0, 1.5]], dtype=np.float32)
    assert_array_equal(depth_of(raw(data, "32FC1")), [[0.0, np.inf, 0.0, 1.5]])


def test_depths_are_told_from_colours_by_their_encoding() -> None:
    depths = ("16UC1", "32FC1", "mono16", "16UC1; compressedDepth png")
    assert all(is_depth(encoding) for encoding in depths)
    assert not any(is_depth(encoding) for encoding in ("rgb8", "mono8", "jpeg", "8UC1"))


@pytest.mark.parametrize(
    ("message", "read", "said"),
    [
        (raw(RGB, "yuv422"), color_of, "'yuv422' is no colour image; need rgb8"),
        (raw(MM, "16UC1"), color_of, "'16UC1' is no colour image"),
        (raw(RGB, "rgb8"), depth_of, "'rgb8' is no depth image; need 16uc1"),
        (raw(RGB, "rgb8", height=60), color_of, "90 bytes with rows of 15 for 5 x 60 pixels"),
        (raw(RGB, "rgb8", step=3), color_of, "rows of 3 for 5 x 6"),
        (raw(RGB, "rgb8", width=0), color_of, "0 x 6 pixels"),
        (raw(RGB, "rgb8", width=2**31), color_of, "need 1 to 8192"),
        (packed(RGB, ".png", "jpeg", b"no image"), color_of, "no JPEG or PNG"),
        (SimpleNamespace(format="png", data=np.zeros(0, np.uint8)), color_of, "no JPEG or PNG"),
        (packed(MM, ".png", "png"), color_of, "uint16; need 8 bit"),
        (packed(MM, ".png", "16UC1; compressedDepth rvl"), depth_of, "republish them"),
        (SimpleNamespace(format="16UC1; compressedDepth", data=b"12"), depth_of, "without data"),
        (packed(RGB, ".png", "16UC1; png"), depth_of, "uint8; need 16UC1"),
    ],
)
def test_other_images_are_refused_in_one_line(
    message: SimpleNamespace, read: object, said: str
) -> None:
    with pytest.raises(RecordingError, match=said) as caught:
        read(message)  # type: ignore[operator]
    assert "\n" not in str(caught.value)
