"""What holds for image files of every format: refusals, masks, writing."""

import io
import struct
import subprocess
import sys
import zlib
from pathlib import Path
from typing import BinaryIO

import imagecodecs
import numpy as np
import OpenEXR
import PIL.Image
import pytest
from handmade import (
    F32,
    GREY,
    GREY_ALPHA,
    HEIGHT,
    RANDOM,
    RGB,
    U8,
    WIDTH,
    gama,
    png_of,
    radiance,
    refusal,
    rgbe_and_values,
    saved,
    tiff,
)

from diffshade.errors import BadInput
from diffshade.io.image import (
    Encoding,
    Format,
    read_image,
    read_mask,
    write_exr,
    write_image,
    write_npy,
    write_png,
)

DATA = Path(__file__).resolve().parents[3] / "shared/data"

# --- what cannot be read


def valid_files() -> dict[str, bytes]:
    big = RANDOM.integers(0, 256, (64, 64, 3), dtype=np.uint8)
    buffer = io.BytesIO()
    PIL.Image.fromarray(big).save(buffer, "tiff", compression="tiff_lzw")
    return {
        "png": png_of(big, RGB),
        "jpeg": bytes(imagecodecs.jpeg8_encode(big)),
        "tiff": tiff(big),
        "tiff-lzw": buffer.getvalue(),
        "hdr": radiance(rgbe_and_values()[0]),
    }


@pytest.mark.parametrize("kind", ["png", "jpeg", "tiff", "tiff-lzw", "hdr"])
def test_a_truncated_file_is_refused(tmp_path: Path, kind: str) -> None:
    content = valid_files()[kind]
    read_image(saved(tmp_path, content))
    for length in (len(content) // 8, len(content) // 2, len(content) - 3):
        refusal(saved(tmp_path, content[:length]))


def test_a_damaged_png_is_refused(tmp_path: Path) -> None:
    for part in (b"gAMA", b"IDAT"):
        content = bytearray(png_of(U8, RGB, gama(1.0)))
        content[content.index(part) + 5] ^= 1
        assert f"damaged in its {part.decode()}" in refusal(saved(tmp_path, content))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "empty"),
        (b"hello, this is text", "not an image"),
        (b"GIF89a" + bytes(20), "GIF"),
        (b"BM" + bytes(20), "BMP"),
    ],
)
def test_what_is_no_image_is_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(content)
    assert reason in refusal(path)


def test_missing_file_and_folder(tmp_path: Path) -> None:
    assert "no such file" in refusal(tmp_path / "absent.png")
    assert "folder" in refusal(tmp_path)


def test_layer_belongs_to_exr(tmp_path: Path) -> None:
    assert "has no layer" in refusal(saved(tmp_path, png_of(U8, RGB)), layer="left")


def test_nonfinite_values_are_counted_and_refused(tmp_path: Path) -> None:
    values = F32.copy()
    values[0, 0] = np.nan, np.inf, -np.inf
    path = saved(tmp_path, tiff(values))
    assert f"3 of {values.size} values" in refusal(path)
    assert np.array_equal(read_image(path, allow_nonfinite=True).values, values, equal_nan=True)


# --- masks


def test_mask_is_any_channel_from_half_on(tmp_path: Path) -> None:
    codes = np.array([[[0, 127, 0], [0, 128, 0], [255, 255, 255], [127, 127, 127]]], np.uint8)
    mask = read_mask(saved(tmp_path, png_of(codes, RGB)))
    assert mask.dtype == np.bool_
    assert mask.tolist() == [[False, True, True, False]]


def test_mask_in_alpha(tmp_path: Path) -> None:
    codes = np.array([[[255, 255], [255, 0], [0, 255]]], np.uint8)
    assert read_mask(saved(tmp_path, png_of(codes, GREY_ALPHA))).tolist() == [[True, False, False]]


def test_mask_with_nothing_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"mask is empty.*0\.00392 of 1"):
        read_mask(saved(tmp_path, png_of(np.array([[0, 1]], np.uint8), GREY)))


# --- writing


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("bits", "mode"), [(8, np.uint8), (16, np.uint16)])
def test_written_png_holds_the_nearest_codes(
    tmp_path: Path, bits: int, mode: type, channels: int
) -> None:
    path = tmp_path / "a.png"
    codes = RANDOM.integers(0, 2**bits, (HEIGHT, WIDTH, channels), dtype=mode)
    write_png(path, codes / (2**bits - 1), bits=bits)
    content = path.read_bytes()
    start = content.index(b"IDAT")
    (length,) = struct.unpack_from(">I", content, start - 4)
    rows = np.frombuffer(zlib.decompress(content[start + 4 : start + 4 + length]), np.uint8)
    assert struct.unpack_from(">IIBB", content, 16) == (
        WIDTH,
        HEIGHT,
        bits,
        GREY if channels == 1 else RGB,
    )
    assert rows.size == HEIGHT * (1 + WIDTH * channels * bits // 8)
    image = read_image(path)
    assert np.array_equal(np.rint(image.values.astype(float) * (2**bits - 1)), codes)
    assert image.encoding is Encoding.DISPLAY


@pytest.mark.parametrize("encoding", list(Encoding))
def test_written_png_says_its_encoding(tmp_path: Path, encoding: Encoding) -> None:
    write_png(tmp_path / "a.png", np.full((2, 2), 0.5), encoding=encoding)
    assert read_image(tmp_path / "a.png").encoding is encoding


def test_write_image_applies_srgb_to_png_alone(tmp_path: Path) -> None:
    linear = np.array([[[-1.0, 0.18, 7.0]]], np.float32)
    for ending in (".png", ".exr", ".npy"):
        write_image(tmp_path / f"a{ending}", linear)
    assert np.array_equal(np.asarray(PIL.Image.open(tmp_path / "a.png")), [[[0, 118, 255]]])
    with OpenEXR.File(str(tmp_path / "a.exr")) as written:
        assert np.array_equal(written.channels()["RGB"].pixels, linear)
    assert np.array_equal(np.load(tmp_path / "a.npy"), linear)
    with pytest.raises(
        BadInput, match=r"\.jpg names no format to write; give \.png, \.exr or \.npy"
    ):
        write_image(tmp_path / "a.jpg", linear)


def test_grey_exr_is_luminance(tmp_path: Path) -> None:
    write_exr(tmp_path / "y.exr", F32[..., 0].astype(np.float64))
    with OpenEXR.File(str(tmp_path / "y.exr")) as written:
        assert np.array_equal(written.channels()["Y"].pixels, F32[..., 0])


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.array([[0.5, 1.01]]), "clip or scale"),
        (np.array([[0.5, np.nan]]), "1 of 2 values"),
        (U8, "type uint8"),
        (np.zeros((2, 2, 4)), "shape"),
        (np.zeros(3), "shape"),
    ],
)
def test_what_a_png_cannot_hold_is_refused(tmp_path: Path, values: np.ndarray, reason: str) -> None:
    with pytest.raises(BadInput, match=reason):
        write_png(tmp_path / "a.png", values)
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.npy"
    write_npy(path, np.arange(3))

    def half_written(file: BinaryIO, *_: object, **__: object) -> None:
        file.write(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "save", half_written)
    with pytest.raises(BadInput, match="No space left on device"):
        write_npy(path, np.zeros(9))
    assert list(tmp_path.iterdir()) == [path]
    assert np.array_equal(np.load(path), np.arange(3))


def test_where_nothing_can_be_written(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="does not exist; create it"):
        write_npy(tmp_path / "absent" / "a.npy", np.zeros(3))
    with pytest.raises(BadInput, match="this is a folder"):
        write_exr(tmp_path, F32)


# --- the whole


def test_import_is_cheap() -> None:
    heavy = ("jax", "imagecodecs", "OpenEXR", "imageio", "PIL", "rawpy")
    script = f"import sys, diffshade.io.image; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


@pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not beside the repository")
def test_real_photographs() -> None:
    ball = read_image(DATA / "diligent_ball/001.png")
    assert (ball.values.shape, ball.bits) == ((172, 172, 3), 16)
    assert ball.values.max() == 1.0, "the highlight clips at 65535"
    assert np.unique(ball.values).size > 256, "more than 8 bits"
    cat = read_image(DATA / "diligent_cat/001.png")
    assert (cat.bits, cat.values.shape[-1]) == (8, 3)
    assert cat.values.max() < 1, "dark, and not stretched"
    probe = read_image(DATA / "psbox/LightProbe-1/Image_01.JPG")
    assert (probe.format, probe.encoding) == (Format.JPEG, Encoding.DISPLAY)
    for mask in DATA.rglob("*mask.png"):
        assert 0.2 < read_mask(mask).mean() < 0.8
