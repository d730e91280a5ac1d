"""Exposure and white balance as cameras write them: EXIF by Pillow, and a DNG put together by hand."""

from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image
import pytest
from capture_files import codes, photometric_stereo, refusal
from handmade import dng
from PIL.TiffImagePlugin import IFDRational

from diffshade.io.capture import Capture
from diffshade.io.exif import Shot, shot_in_tiff
from diffshade.io.image import read_image
from diffshade.io.read_capture import read_capture
from diffshade.io.write_capture import write_capture

EXPOSURE_TIME, F_NUMBER, SENSITIVITY, WHITE_BALANCE = 33434, 33437, 34855, 41987
PHONE = {
    EXPOSURE_TIME: IFDRational(1, 60),
    F_NUMBER: IFDRational(18, 10),
    SENSITIVITY: 100,
    WHITE_BALANCE: 1,
}

UP = "0 0 1\n"


def exif(**tags: Any) -> bytes:
    """A whole EXIF block, with the tags where the standard has them."""
    block = PIL.Image.Exif()
    block.get_ifd(34665).update(tags["tags"])
    return block.tobytes()


def picture(path: Path, tags: dict[int, Any] | None, kind: str = "jpeg") -> Path:
    pixels = (codes(int(path.stem[-1]), (12, 16, 3)) >> 8).astype(np.uint8)
    options: Any = {} if tags is None else {"exif": exif(tags=tags)}
    PIL.Image.fromarray(pixels).save(path, kind, **options)
    return path


def capture(folder: Path, *tags: dict[int, Any] | None, stated: tuple[Any, ...] = ()) -> Path:
    """A `capture.toml` of one JPEG each, with stated exposures."""
    text = 'schema = "diffshade.capture/1"\n'
    text += 'geometry = { kind = "sphere", center = [0, 0, 0], radius = 1.0 }\n'
    text += 'camera = { kind = "orthographic", width = 16, height = 12, extent = 2.2 }\n'
    for k, own in enumerate(tags):
        picture(folder / f"{k}.jpg", own)
        text += f'[[image]]\nfile = "{k}.jpg"\n'
        text += 'lights = [{ kind = "parallel", direction = [0, 0, 1], intensity = 1.0 }]\n'
        if k < len(stated) and stated[k] is not None:
            text += f"exposure = {stated[k]}\n"
    path = folder / "capture.toml"
    path.write_text(text)
    return path


def told(found: Capture, *words: str) -> list[str]:
    return [note for note in found.notes if any(word in note for word in words)]


@pytest.mark.parametrize("kind", ["jpeg", "tiff"])
def test_what_a_photograph_was_taken_with(kind: str, tmp_path: Path) -> None:
    image = read_image(picture(tmp_path / "1.dat", PHONE, kind))
    assert image.shot is not None
    assert image.shot.seconds == pytest.approx(1 / 60)
    assert image.shot[1:] == (1.8, 100, False)
    assert image.shot.words() == "1/60 s f/1.8 ISO 100"
    assert read_image(picture(tmp_path / "2.dat", None, kind)).shot is None


def test_it_is_read_from_raw_without_a_white_balance(tmp_path: Path) -> None:
    """The sensor's values have none; TIFF/EP has the tags in its first directory."""
    pytest.importorskip("rawpy", reason="camera RAW is an extra")
    taken = {EXPOSURE_TIME: (5, [1, 250]), F_NUMBER: (5, [56, 10]), WHITE_BALANCE: (3, [0])}
    data = dng(np.full((64, 64), 9000, np.uint16), 0, 65535, taken)
    (tmp_path / "a.dng").write_bytes(data)
    assert shot_in_tiff(data) == Shot(1 / 250, 5.6, None, automatic_white=True)
    assert read_image(tmp_path / "a.dng").shot == Shot(1 / 250, 5.6, None)


@pytest.mark.parametrize(
    ("changed", "words", "factor"),
    [
        ({EXPOSURE_TIME: IFDRational(1, 125)}, "1/125 s f/1.8 ISO 100 in 1.jpg", "2.08"),
        ({SENSITIVITY: 400}, "1/60 s f/1.8 ISO 400 in 1.jpg", "4"),
        ({F_NUMBER: IFDRational(36, 10)}, "1/60 s f/3.6 ISO 100 in 1.jpg", "4"),
        ({EXPOSURE_TIME: IFDRational(2, 1)}, "2 s f/1.8 ISO 100 in 1.jpg", "120"),
    ],
)
def test_exposures_that_differ_are_told_and_not_divided_by(
    changed: dict[int, Any], words: str, factor: str, tmp_path: Path
) -> None:
    plain = read_capture(capture(tmp_path, None, None))
    assert not told(plain, "EXIF", "exposure")
    found = read_capture(capture(tmp_path, PHONE, {**PHONE, **changed}, PHONE))
    (note,) = told(found, "EXIF")
    assert words in note
    assert "1/60 s f/1.8 ISO 100 in " in note
    assert f"a factor of {factor}, and nothing was divided by it; give" in note
    np.testing.assert_array_equal(found.images[1], plain.images[1])


def test_exposures_that_make_up_for_each_other_are_one(tmp_path: Path) -> None:
    """Half as long at twice the sensitivity, and what only some files say is not compared."""
    other = {**PHONE, EXPOSURE_TIME: IFDRational(1, 120), SENSITIVITY: 200}
    assert not told(read_capture(capture(tmp_path, PHONE, other)), "EXIF")
    less = {EXPOSURE_TIME: IFDRational(1, 60)}
    assert not told(read_capture(capture(tmp_path, PHONE, less, None)), "EXIF")


def test_an_automatic_white_balance_is_told(tmp_path: Path) -> None:
    automatic = {**PHONE, WHITE_BALANCE: 0}
    (note,) = told(read_capture(capture(tmp_path, automatic, PHONE, automatic)), "EXIF")
    assert note.startswith("white balance was automatic in 2 images (0.jpg, ...)")
    assert not told(read_capture(capture(tmp_path, automatic)), "EXIF"), (
        "one has none to differ from"
    )


def test_stated_exposures_divide_the_images(tmp_path: Path) -> None:
    plain = read_capture(capture(tmp_path, None, None))
    path = capture(tmp_path, PHONE, {**PHONE, EXPOSURE_TIME: IFDRational(1, 240)}, stated=(1, 0.25))
    found = read_capture(path)
    np.testing.assert_array_equal(found.images[0], plain.images[0])
    np.testing.assert_allclose(found.images[1], 4 * plain.images[1], rtol=1e-6)
    assert (found.clipped[1] == plain.clipped[1]).all()
    assert told(found, "exposure") == ["images divided by stated exposures from 0.25 to 1"]
    assert not told(read_capture(capture(tmp_path, PHONE, PHONE, stated=(1, 1))), "exposure")


def test_stated_exposures_that_the_files_deny_are_told(tmp_path: Path) -> None:
    """Seconds alone, where the sensitivity changed too."""
    other = {**PHONE, EXPOSURE_TIME: IFDRational(1, 120), SENSITIVITY: 200}
    found = read_capture(capture(tmp_path, PHONE, other, stated=(1 / 60, 1 / 120)))
    _, note = told(found, "exposure")
    assert (
        "disagree with EXIF by a factor of 2: 0.008333 for 1/120 s f/1.8 ISO 200 in 1.jpg" in note
    )


@pytest.mark.parametrize("channels", [1, 3])
def test_intensities_of_lights_are_not_compared(channels: int, tmp_path: Path) -> None:
    """Nor where a capture with them is written, which calls both an exposure."""
    folder, new = tmp_path / "folder", tmp_path / "new"
    names = ["0.jpg", "1.jpg"]
    photometric_stereo(folder, {}, filenames_txt="\n".join(names), light_directions_txt=UP * 2)
    for name in names:
        image = PIL.Image.fromarray((codes(3, (12, 16, 3)) >> 8).astype(np.uint8))
        image.convert("RGB" if channels == 3 else "L").save(folder / name, exif=exif(tags=PHONE))
    (folder / "light_intensities.txt").write_text("1\n0.5\n")
    given = read_capture(folder, circle=(8.0, 6.0, 5.0), encoding="srgb")
    write_capture(new, given)
    found = read_capture(new)
    np.testing.assert_array_equal(found.images, given.images)
    assert not told(given, "EXIF")
    assert not told(found, "EXIF")


def test_a_stated_exposure_is_still_compared_where_it_was_written(tmp_path: Path) -> None:
    given = read_capture(capture(tmp_path, PHONE, PHONE, stated=(1, 0.5)))
    write_capture(tmp_path / "new", given)
    (note,) = told(read_capture(tmp_path / "new"), "EXIF")
    assert "disagree with EXIF by a factor of 2" in note
    listed = read_capture(capture(tmp_path, PHONE, PHONE, stated=([1], [0.5])))
    assert not told(listed, "EXIF")


@pytest.mark.parametrize(
    ("stated", "complaint"),
    [
        ((1, None), "image 2: has no exposure where others have"),
        ((1, 0), "image 2: exposure is 0; give a number above 0"),
        ((1, '"1/60"'), "image 2: exposure is '1/60'; give a number above 0"),
        ((1e-30, 1), "image 1: exposure is 1e-30; give seconds"),
    ],
)
def test_exposures_that_cannot_be_are_refused(
    stated: tuple[Any, ...], complaint: str, tmp_path: Path
) -> None:
    assert complaint in refusal(capture(tmp_path, None, None, stated=stated))


@pytest.mark.parametrize(
    "tags",
    [
        {EXPOSURE_TIME: IFDRational(0, 0), SENSITIVITY: 0},
        {EXPOSURE_TIME: IFDRational(0, 1), F_NUMBER: IFDRational(1, 0)},
    ],
)
def test_numbers_that_are_none_say_nothing(tags: dict[int, Any], tmp_path: Path) -> None:
    assert read_image(picture(tmp_path / "1.jpg", tags)).shot is None


def test_damaged_metadata_does_not_cost_the_picture(tmp_path: Path) -> None:
    whole = picture(tmp_path / "1.jpg", PHONE).read_bytes()
    pixels = read_image(tmp_path / "1.jpg").values
    block = exif(tags=PHONE)
    start = whole.index(block)
    for k in range(6, len(block)):
        damaged = bytearray(whole)
        damaged[start + k] ^= 0xFF
        (tmp_path / "2.jpg").write_bytes(damaged)
        np.testing.assert_array_equal(read_image(tmp_path / "2.jpg").values, pixels)


def test_metadata_of_no_tiff_say_nothing() -> None:
    for data in (
        b"",
        b"II*\0",
        b"II*\0\xff\xff\xff\xff",
        b"MM\0*" + bytes(4),
        b"FUJIFILMCCD-RAW" * 9,
    ):
        assert shot_in_tiff(data) is None
