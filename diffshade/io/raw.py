"""Camera RAW through LibRaw (package `rawpy`, the extra `raw`): linear, in the sensor's colours."""

from pathlib import Path

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, with_channels
from diffshade.io.encoding import Encoding
from diffshade.io.limits import check_size
from diffshade.io.quiet import quietly

__all__ = ["SIGNATURES", "read"]

SIGNATURES = (
    (0, b"FUJIFILMCCD-RAW"),
    (0, b"IIRO"),
    (0, b"IIRS"),
    (0, b"MMOR"),
    (0, b"IIU\x00"),
    (0, b"\x00MRM"),
    (0, b"FOVb"),
    (4, b"ftypcrx "),
    (6, b"HEAPCCDR"),
    (8, b"CR\x02"),
)


def read(path: Path) -> Decoded:
    """Demosaiced sensor values, black level 0 and white level full scale; no white balance.

    The same scale for every frame of a camera: LibRaw's own defaults would brighten each by its
    own maximum. Rows as stored by the sensor. Raises `BadInput` where rawpy is not installed.
    """
    try:
        import rawpy
    except ImportError:
        raise BadInput(
            "is a camera RAW file, which needs the package rawpy; pip install 'diffshade[raw]'"
        ) from None

    with quietly(), rawpy.RawPy() as raw:
        raw.open_file(str(path))
        check_size((raw.sizes.raw_height, raw.sizes.raw_width, 3))
        raw.unpack()
        samples = raw.postprocess(
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,
            output_bps=16,
            user_wb=[1, 1, 1, 1],
            output_color=rawpy.ColorSpace.raw,
            user_flip=0,
        )
        bits = int(raw.white_level).bit_length()
    return Decoded(with_channels(samples), full_code=65535, bits=bits, encoding=Encoding.LINEAR)
