"""JPEG: 8 bits, display-referred.

Pixels stand in the order of the sensor: the orientation flag of EXIF is not applied, because
photographs of one camera that stands still must keep one orientation.
"""

from diffshade.errors import BadInput
from diffshade.io.decoded import Decoded, with_channels
from diffshade.io.encoding import Encoding

__all__ = ["read"]


def read(data: bytes) -> Decoded:
    """Samples of a grey or YCbCr JPEG; raises where data are missing, refuses CMYK."""
    # Pillow raises for a truncated JPEG; libjpeg alone fills the rest with grey and says nothing.
    import imageio.v3 as iio

    samples = with_channels(iio.imread(data, extension=".jpg", plugin="pillow"))
    if samples.shape[-1] not in (1, 3):
        raise BadInput("is a CMYK JPEG; convert it to RGB")
    return Decoded(samples, full_code=255, bits=8, encoding=Encoding.DISPLAY)
